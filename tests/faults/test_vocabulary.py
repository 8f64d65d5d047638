"""One vocabulary of injected faults for twin and emulators; what is not in it is refused, and nothing is opened."""

from __future__ import annotations

from pathlib import Path

import pytest

from drivers.twin.faults import DEVICES, Verb
from robot.cli import run_command

USAGE = 64
COMMANDS = {
    "run": ["run", "--config", "demo.toml", "--start", "--speed", "0", "--out", "out"],
    "run over emulators": ["run", "--config", "emulated.toml", "--emulate", "--start", "--out", "out"],
    "emulate": ["emulate", "--json", "--truth", "out/truth.jsonl"],
    "jog": ["jog", "joint", "waist", "0.1", "--config", "demo.toml", "--out", "out"],
    "spray": ["spray", "--ml", "2", "--config", "demo.toml", "--out", "out", "--yes"],
}
FAULTS = {
    "device": ("lidar:off@3s", ("unknown device 'lidar'", *DEVICES)),
    "verb": ("relay:melted@3s", ("unknown verb 'melted'", *Verb)),
    "verb of a valve": ("valve:garbage", ("a valve cannot be garbage", "stuck")),
    "number of the catalogue": ("F08@3s", ("expected device:verb@start+duration", "relay:garbage@12s+3s")),
    "moment": ("relay:off@soon", ("expected device:verb@start+duration",)),
    "duration": ("relay:off@3s+0s", ("a duration above 0 s",)),
}


@pytest.mark.parametrize("fault", FAULTS)
@pytest.mark.parametrize("command", COMMANDS)
def test_an_unknown_fault_is_refused_with_the_known_ones_and_nothing_is_opened(
    command: str, fault: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    text, words = FAULTS[fault]
    code = run_command([*COMMANDS[command], "--fault", text])
    shown = capsys.readouterr()
    assert code == USAGE, shown.err
    assert shown.out == ""
    assert shown.err.startswith("sprayer: --fault: fault: ")
    assert shown.err.count("\n") == 1
    for word in words:
        assert word in shown.err
    assert list(tmp_path.iterdir()) == []


def test_real_hardware_takes_no_injected_fault(tmp_path: Path, monkeypatch, capsys) -> None:
    monkeypatch.chdir(tmp_path)
    assert run_command(["run", "--config", "rover.toml", "--out", "out", "--fault", "relay:off@1s"]) == USAGE
    assert "the simulated machine only" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []

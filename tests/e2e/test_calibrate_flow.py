"""``sprayer calibrate flow``: a cup under the simulated nozzle, and the nozzle's true flow found from it."""

from __future__ import annotations

import re
import signal
import subprocess
import time
import tomllib
from collections.abc import Callable
from pathlib import Path

import pytest

from drivers.relay.values import Channel
from drivers.twin.aftermath import run_on
from drivers.twin.commands import RelayPulse, RelaySwitch
from drivers.twin.truth_record import read_truth
from robot.ledger import Outcome

from .by_hand import command, process, shots, totals
from .rover_process import DEADLINE_S, DEMO, SPRAYER, short_row
from .test_bad_input import CONFIG, FILE, USAGE, Told, refused

__all__ = ["refused"]

FAILED = 1


class Cup:
    """Stands under the true nozzle; what it says when it is read is what fell into it since."""

    def __init__(self, out: Path, told: Callable[[float, int], str] = lambda ml, _number: f"{ml:.1f}\n") -> None:
        self._truth, self._told = out / "truth.jsonl", told
        self._emptied_ml, self._number = 0.0, 0

    def readline(self) -> str:
        given_ml = sum(delivered.ml for delivered in read_truth(self._truth).processes[-1].delivered)
        self._number += 1
        caught_ml, self._emptied_ml = given_ml - self._emptied_ml, given_ml
        return self._told(caught_ml, self._number)


def calibrate(out: Path, *more: str, config: Path = DEMO) -> int:
    return command(out, "calibrate", "flow", "--yes", *more, config=config)


@pytest.fixture
def mine(tmp_path: Path) -> Path:
    """A configuration of one's own, with ends of line of another system."""
    path = short_row(tmp_path)
    path.write_bytes(path.read_bytes().replace(b"\n", b"\r\n"))
    path.chmod(0o640)
    return path


def test_the_true_flow_and_lag_are_found_and_only_they_are_written(
    tmp_path: Path, mine: Path, monkeypatch, capsys
) -> None:
    out, before = tmp_path / "out", mine.read_bytes()
    monkeypatch.setattr("sys.stdin", Cup(out))
    assert calibrate(out, "--write", str(mine), config=mine) == 0
    true = process(out).world["true"]
    dead_s = true["valve_open_s"] - true["valve_close_s"]
    fluid = tomllib.loads(mine.read_text())["fluid"]
    assert fluid["nozzle_flow_ml_s"] == pytest.approx(true["nozzle_flow_ml_s"], rel=0.01)
    assert fluid["valve_open_s"] - fluid["valve_close_s"] == pytest.approx(dead_s, abs=0.004)
    lines = list(zip(before.splitlines(True), mine.read_bytes().splitlines(True), strict=True))
    changed = [(old.partition(b"=")[0].strip(), old, new) for old, new in lines if old != new]
    assert {key for key, _, _ in changed} <= {b"nozzle_flow_ml_s", b"valve_open_s", b"valve_close_s"}
    assert len(changed) >= 2
    assert mine.stat().st_mode & 0o777 == 0o640
    told = capsys.readouterr().out
    for _, old, new in changed:
        assert f"-{old.decode().rstrip()}" in told
        assert f"+{new.decode().rstrip()}" in told
    meter = re.search(r"flow meter: counted (\S+)%", told)
    assert meter is not None
    assert float(meter[1]) == pytest.approx(100.0 * (true["flow_meter_gain"] - 1.0), abs=0.7)


def test_every_pulse_is_in_the_ledger_within_the_caps(tmp_path: Path, monkeypatch) -> None:
    out = tmp_path / "out"
    config = short_row(tmp_path, **{"max_minute_ml = 200.0": "max_minute_ml = 60.0"})
    monkeypatch.setattr("sys.stdin", Cup(out))
    assert calibrate(out, config=config) == 0
    given_ml = run_on(out / "truth.jsonl").total_ml
    done = shots(out)
    assert len(done) == 25
    assert all(shot.result.outcome is Outcome.SPRAYED for shot in done)
    assert given_ml <= totals(out).booked_ml <= 1.05 * given_ml + 0.17
    assert max(shot.intent.dose_ml for shot in done) <= 15.0
    for shot in done:
        minute = [s.result for s in done if -1e-9 <= shot.result.stamp_s - s.result.stamp_s < 60.0]
        assert sum(result.booked_ml for result in minute) <= 60.0
    assert not any(run_on(out / "truth.jsonl").coils.values())


def test_the_pump_rests_while_a_cup_is_looked_at(tmp_path: Path, monkeypatch) -> None:
    out = tmp_path / "out"
    pumping: list[bool] = []

    def look(ml: float, _number: int) -> str:
        asked = [timed.command for timed in process(out).commands]
        pump = [each for each in asked if isinstance(each, RelayPulse | RelaySwitch) and each.channel is Channel.PUMP]
        pumping.append(isinstance(pump[-1], RelayPulse))
        return f"{ml:.1f}\n"

    monkeypatch.setattr("sys.stdin", Cup(out, look))
    assert calibrate(out, "--pulses", "1") == 0
    assert pumping == [False] * 5


def test_cups_can_be_weighed(tmp_path: Path, monkeypatch, capsys) -> None:
    out = tmp_path / "out"
    monkeypatch.setattr("sys.stdin", Cup(out, lambda ml, _: f"{1.08 * ml:.1f}".replace(".", ",") + "\n"))
    assert calibrate(out, "--density", "1.08") == 0
    told = capsys.readouterr().out
    assert "caught g?" in told
    flow = re.search(r"nozzle_flow_ml_s = (\S+)", told)
    assert flow is not None
    assert float(flow[1]) == pytest.approx(process(out).world["true"]["nozzle_flow_ml_s"], rel=0.01)


def test_lengths_and_pulses_can_be_chosen(tmp_path: Path, monkeypatch) -> None:
    out = tmp_path / "out"
    monkeypatch.setattr("sys.stdin", Cup(out))
    lengths = ("0.9", "0.2", "0.4", "0.6")
    assert calibrate(out, "--pulses", "2", *(word for length in lengths for word in ("--open-s", length))) == 0
    assert [shot.intent.open_s for shot in shots(out)] == [0.2, 0.2, 0.4, 0.4, 0.6, 0.6, 0.9, 0.9]


@pytest.mark.parametrize("spilt", [1, 2, 3, 4, 5])
def test_a_spilt_cup_is_named_and_nothing_is_written(
    tmp_path: Path, mine: Path, monkeypatch, refused: Told, spilt
) -> None:
    out, before = tmp_path / "out", mine.read_bytes()

    def spill(ml: float, number: int) -> str:
        return f"{ml - (2.0 + 0.1 * ml if number == spilt else 0.0):.1f}\n"

    monkeypatch.setattr("sys.stdin", Cup(out, spill))
    code = calibrate(out, "--write", str(mine), config=mine)
    lengths = sorted({shot.intent.open_s for shot in shots(out)})
    refused(code, FAILED, "no calibration", f"the cup of 5 x {lengths[spilt - 1]:.3f} s", "catch it again")
    assert mine.read_bytes() == before


@pytest.mark.parametrize("answer", ["", "\n", "much\n", "-3\n", "nan\n", "0\n"])
def test_an_answer_that_is_none_ends_it_and_nothing_is_written(
    tmp_path: Path, mine: Path, monkeypatch, refused: Told, answer
) -> None:
    out, before = tmp_path / "out", mine.read_bytes()
    monkeypatch.setattr("sys.stdin", Cup(out, lambda ml, number: answer if number == 3 else f"{ml:.1f}\n"))
    refused(calibrate(out, "--write", str(mine), config=mine), USAGE, "cup 3 of 5", "expected ml above 0")
    assert mine.read_bytes() == before
    after = run_on(out / "truth.jsonl")
    assert not any(after.coils.values())
    assert totals(out).booked_ml >= after.total_ml


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("--open-s", "3", "--open-s", "0.1"), ("--open-s 3", "caps allow 0.08 to 1.1")),
        (("--open-s", "0.01"), ("--open-s 0.01",)),
        (("--open-s", "nan"), ("--open-s nan",)),
        (("--open-s", "0.2", "--open-s", "0.4"), ("4 pulse lengths or more",)),
        (("--pulses", "0"), ("--pulses",)),
        (("--pulses", "51"), ("--pulses",)),
        (("--density", "nan"), ("--density nan",)),
        (("--density", "800"), ("--density 800", "water has 1")),
    ],
)
def test_a_silly_test_is_refused_before_anything_is_sprayed(tmp_path: Path, refused: Told, words, told) -> None:
    refused(calibrate(tmp_path / "out", *words), USAGE, *told)
    assert not (tmp_path / "out" / "truth.jsonl").exists()


def test_more_than_the_label_allows_is_refused(tmp_path: Path, refused: Told) -> None:
    config = short_row(tmp_path, **{"label_cap_ml = 2000.0": "label_cap_ml = 100.0"})
    refused(calibrate(tmp_path / "out", config=config), USAGE, "more than label and tank allow", "--pulses")
    assert not (tmp_path / "out" / "truth.jsonl").exists()


def test_a_file_that_the_values_cannot_be_put_into_is_refused_before_anything_is_sprayed(
    tmp_path: Path, refused: Told
) -> None:
    other = tmp_path / "other.toml"
    other.write_text("[fluids]\nnozzle_flow_ml_s = 12.6\n")
    refused(calibrate(tmp_path / "out", "--write", str(other)), CONFIG, "other.toml: [fluid] has no line")
    refused(calibrate(tmp_path / "out", "--write", str(tmp_path / "gone.toml")), FILE, "gone.toml: cannot be read")
    assert not (tmp_path / "out" / "truth.jsonl").exists()


def test_a_valve_that_stays_shut_ends_the_test(tmp_path: Path, monkeypatch, capsys) -> None:
    out = tmp_path / "out"
    monkeypatch.setattr("sys.stdin", Cup(out))
    assert calibrate(out, "--fault", "valve:off@8s") == FAILED
    assert "flow meter saw" in capsys.readouterr().err
    assert totals(out).booked_ml >= run_on(out / "truth.jsonl").total_ml


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_while_it_waits_for_an_answer_ends_it_clean(tmp_path: Path, number: signal.Signals) -> None:
    out = tmp_path / "out"
    out.mkdir()
    words = ["calibrate", "flow", "--config", str(DEMO), "--out", str(out), "--truth", str(out / "truth.jsonl")]
    running = subprocess.Popen(
        [*SPRAYER, *words, "--speed", "0"], stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        text=True,
    )  # fmt: skip
    assert running.stdin is not None
    assert running.stdout is not None
    running.stdin.write("yes\n")
    running.stdin.flush()
    said = ""
    while "cup 1 of 5" not in said:
        said += running.stdout.read(1)
    time.sleep(0.3)
    running.send_signal(number)
    _, errors = running.communicate(timeout=DEADLINE_S)
    assert running.returncode == 0, errors
    assert f"stopped by {number.name}" in errors
    after = run_on(out / "truth.jsonl")
    assert not any(after.coils.values())
    assert totals(out).booked_ml >= after.total_ml

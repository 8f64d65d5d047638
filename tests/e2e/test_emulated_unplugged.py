"""A device of the rover is unplugged in the middle of a mission over real bytes, and plugged in again.

Real time: a short row, and the trained detector, which finds fruits enough to spray for a while. What moves or sprays
ends the mission in a safe stop; what only informs does not.
"""

from __future__ import annotations

import json
import math
import os
import subprocess
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from drivers.byte_trace import Chunk, read_trace
from drivers.relay.values import Channel
from drivers.twin.aftermath import Aftermath, run_on
from drivers.twin.commands import ArmGoal, RelayPulse, WheelsDrive
from drivers.twin.truth_record import ProcessTruth, read_truth
from robot.cli import run_command
from robot.ledger import LedgerReader
from robot.package_files import packaged

from .conftest import EYES
from .emulated import drives
from .rover_process import SPRAYER

AT_S = 9.0  # the arm is at work then
BLINK_S = 0.4  # as a loose plug does; the port is back before the robot has let go of the others
NOTICED_S = 1.5  # what is asked later than that was asked in spite of the loss
VALVE_LAG_S = 0.1
EMULATED = packaged("configs") / "emulated.toml"


def short_row(folder: Path, **replaced: str) -> Path:
    """The emulated rover on a row of two stops."""
    (folder / "routes").mkdir(exist_ok=True)
    (folder / "routes" / "short.toml").write_text(
        'name = "short"\n[[row]]\nname = "A"\nside = "left"\nlength_m = 1.6\nstops_m = [0.45, 0.85]\n'
    )
    text = EMULATED.read_text().replace("routes/demo.toml", "routes/short.toml")
    for old, new in replaced.items():
        assert old in text
        text = text.replace(old, new)
    path = folder / "short.toml"
    path.write_text(text)
    return path


@dataclass(frozen=True)
class Run:
    state: str
    mode: str
    said: str
    causes: str
    after: Aftermath
    process: ProcessTruth
    booked_ml: float
    folder: Path

    def heard(self, device: str) -> Iterator[Chunk]:
        """What went over a device's port."""
        return read_trace(self.folder / "trace" / f"{device}.trace.jsonl")[1]

    @property
    def began_s(self) -> float:
        """When the mission first moved something."""
        return min((t for t, command in self._asked() if _moves(command)), default=math.inf)

    @property
    def openings(self) -> list[tuple[float, float]]:
        """When the valve was told to open, and for how long."""
        return [
            (timed.t, timed.command.duration_s)
            for timed in self.process.commands
            if isinstance(timed.command, RelayPulse) and timed.command.channel is Channel.VALVE
        ]

    def asked_after(self, at_s: float) -> list[object]:
        """Commands that move or open, given later than ``at_s``."""
        return [command for t, command in self._asked() if t > at_s and _moves(command)]

    def _asked(self) -> list[tuple[float, object]]:
        return [(timed.t, timed.command) for timed in self.process.commands]

    def require_safe(self) -> None:
        """Valve and pump off for good, no opening longer than it was told, every millilitre booked."""
        assert not self.after.coils[Channel.VALVE]
        assert not self.after.coils[Channel.PUMP]
        longest_s = max((duration_s for _, duration_s in self.openings), default=0.0)
        assert self.after.longest_opening_s <= longest_s + VALVE_LAG_S
        assert self.booked_ml >= self.after.total_ml - 0.01


def _moves(command: object) -> bool:
    return isinstance(command, ArmGoal | RelayPulse) or (isinstance(command, WheelsDrive) and drives(command))


def drive(folder: Path, *faults: str, more: tuple[str, ...] = (), config: Path | None = None) -> Run:
    config = config or short_row(folder)
    command = [
        *SPRAYER, "run", "--config", str(config), "--emulate", "--start", "--out", str(folder / "out"),
        "--truth", str(folder / "truth.jsonl"), "--summary", str(folder / "summary.json"),
        "--trace", str(folder / "trace"), *more,
    ]  # fmt: skip
    for fault in faults:
        command += ["--fault", fault]
    env = {name: value for name, value in os.environ.items() if name not in EYES}
    done = subprocess.run(command, env=env, capture_output=True, text=True, timeout=180, check=False)
    summary = json.loads((folder / "summary.json").read_text())
    assert done.returncode == (0 if summary["state"] == "done" else 1), done.stderr
    with LedgerReader.open_read_only(folder / "out" / "ledger.sqlite") as ledger:
        totals = [ledger.totals(row.task_id) for row in ledger.tasks()]
    truth = folder / "truth.jsonl"
    return Run(
        summary["state"], summary["mode"], done.stderr, "; ".join(summary["causes"]), run_on(truth),
        read_truth(truth).processes[-1], sum(total.booked_ml + total.pending_ml for total in totals), folder,
    )  # fmt: skip


def pull(folder: Path, device: str, at_s: float, for_s: float) -> tuple[float, Run]:
    """A run in which the plug is out from ``at_s`` on, or later where the robot needs longer to come up."""
    while True:
        run = drive(folder, f"{device}:unplugged@{at_s}s+{for_s}s")
        if run.began_s < at_s:
            return at_s, run
        assert at_s < 30.0, run.said
        at_s += 4.0
        folder = folder / "later"
        folder.mkdir()


LONG = pytest.mark.long


@pytest.mark.parametrize(
    ("device", "named", "at_s"),
    [
        ("relay", "relay", AT_S),
        pytest.param("relay", "relay", 5.0, marks=LONG),  # on the way to the first stop
        pytest.param("inputs", "relay", AT_S, marks=LONG),  # they share the relay's port
        pytest.param("wheels", "wheels", AT_S, marks=LONG),
        pytest.param("wheels", "wheels", 5.0, marks=LONG),
        pytest.param("arm", "arm", AT_S, marks=LONG),
        pytest.param("arm", "arm", 11.0, marks=LONG),
    ],
)
def test_what_moves_or_sprays_ends_in_a_safe_stop_and_does_not_go_on_when_it_is_back(
    device: str, named: str, at_s: float, tmp_path: Path
) -> None:
    at_s, run = pull(tmp_path, device, at_s, BLINK_S)
    assert run.mode == "safe_stop", run.said
    assert f"{named}: expected " in run.causes
    assert run.asked_after(at_s + NOTICED_S) == []
    run.require_safe()


@LONG
def test_the_traces_of_a_stopped_mission_can_be_read(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    _, run = pull(tmp_path, "relay", AT_S, BLINK_S)
    for device in ("arm", "gps", "modem", "relay", "wheels"):
        assert run_command(["trace", str(run.folder / "trace" / f"{device}.trace.jsonl")]) == 0
        lines = capsys.readouterr().out.splitlines()
        assert lines[0].startswith(f"# {device} at ")
        assert {line[14] for line in lines[1:]} >= {"<", ">"} - ({">"} if device == "gps" else set())


@LONG
@pytest.mark.parametrize(("at_s", "for_s", "sprayed"), [(6.0, 10.0, False), (10.0, 25.0, True)])
def test_a_camera_that_is_not_there_at_a_stop_ends_in_a_safe_stop(
    tmp_path: Path, at_s: float, for_s: float, sprayed: bool
) -> None:
    _, run = pull(tmp_path, "camera", at_s, for_s)
    assert run.mode == "safe_stop", run.said
    assert "camera: expected " in run.causes
    assert (run.after.total_ml > 1.0) == sprayed  # what a picture had shown before was sprayed
    run.require_safe()


@LONG
def test_a_relay_board_that_is_unplugged_while_the_valve_is_open_shuts_it_by_itself(tmp_path: Path) -> None:
    """Real time is not the same twice: where the first runs' openings were, the next are, more or less."""
    generous = {"min_ml = 1.5": "min_ml = 10.0"}  # openings of 0.8 s and more are easier to meet
    (tmp_path / "first").mkdir()
    openings = drive(tmp_path / "first", config=short_row(tmp_path / "first", **generous)).openings
    for attempt, (opened_s, duration_s) in enumerate(openings[:4]):
        folder = tmp_path / str(attempt)
        folder.mkdir()
        at_s = opened_s + 0.5 * duration_s
        run = drive(folder, f"relay:unplugged@{at_s}s+1s", config=short_row(folder, **generous))
        assert run.mode == "safe_stop" or run.began_s > at_s, run.said
        assert run.asked_after(at_s + NOTICED_S) == [] or run.began_s > at_s
        run.require_safe()
        if any(began_s < at_s < began_s + length_s for began_s, length_s in run.openings):
            return
    raise AssertionError("no attempt met an open valve")


@LONG
@pytest.mark.parametrize(("device", "for_s"), [("gps", 2.0), ("modem", 11.0)])  # the modem is asked every 10 s
def test_the_mission_goes_on_without_what_only_informs_and_uses_it_again(
    device: str, for_s: float, tmp_path: Path
) -> None:
    at_s, run = pull(tmp_path, device, 6.0, for_s)
    assert run.state == "done", run.said
    assert f"{device}: expected " in run.said
    stamps_s = [chunk.stamp_s for chunk in run.heard(device) if chunk.direction == "in"]
    assert not any(at_s + 0.2 < stamp_s < at_s + for_s for stamp_s in stamps_s)
    assert any(stamp_s > at_s + for_s for stamp_s in stamps_s)
    assert run.after.total_ml > 1.0
    run.require_safe()


@LONG
def test_a_row_that_an_unplugged_relay_ended_is_finished_by_a_resume(tmp_path: Path) -> None:
    _, first = pull(tmp_path, "relay", AT_S, 2.0)
    assert first.mode == "safe_stop"
    second = drive(first.folder, more=("--resume",), config=first.folder / "short.toml")
    assert second.state == "done", second.said
    assert second.after.total_ml > first.after.total_ml + 1.0
    second.require_safe()

"""A device of the rover is unplugged in the middle of a mission over real bytes, and plugged in again.

Real time: a short row. What moves or sprays ends the mission in a safe stop; what only informs does not.
"""

from __future__ import annotations

import json
import subprocess
from dataclasses import dataclass
from pathlib import Path

import pytest

from drivers.twin.aftermath import Aftermath, run_on
from drivers.twin.commands import ArmGoal, RelayPulse, WheelsDrive
from drivers.twin.truth_record import ProcessTruth, read_truth
from robot.ledger import LedgerReader
from robot.package_files import packaged

from .rover_process import SPRAYER

UNPLUGGED_S, FOR_S = 9.0, 2.0
EMULATED = packaged("configs") / "emulated.toml"


def short_row(folder: Path) -> Path:
    """The emulated rover on a row of two stops."""
    (folder / "routes").mkdir()
    (folder / "routes" / "short.toml").write_text(
        'name = "short"\n[[row]]\nname = "A"\nside = "left"\nlength_m = 1.6\nstops_m = [0.45, 0.85]\n'
    )
    path = folder / "short.toml"
    path.write_text(EMULATED.read_text().replace("routes/demo.toml", "routes/short.toml"))
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


def drive(folder: Path, *faults: str, more: tuple[str, ...] = (), config: Path | None = None) -> Run:
    config = config or short_row(folder)
    command = [
        *SPRAYER, "run", "--config", str(config), "--emulate", "--start", "--out", str(folder / "out"),
        "--truth", str(folder / "truth.jsonl"), "--summary", str(folder / "summary.json"), *more,
    ]  # fmt: skip
    for fault in faults:
        command += ["--fault", fault]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    summary = json.loads((folder / "summary.json").read_text())
    with LedgerReader.open_read_only(folder / "out" / "ledger.sqlite") as ledger:
        booked_ml = sum(ledger.totals(row.task_id).booked_ml for row in ledger.tasks())
    truth = folder / "truth.jsonl"
    return Run(
        summary["state"], summary["mode"], done.stderr, "; ".join(summary["causes"]), run_on(truth),
        read_truth(truth).processes[-1], booked_ml,
    )  # fmt: skip


def asked_after(process: ProcessTruth, at_s: float) -> list[object]:
    """Commands that move or open, given later than ``at_s``."""
    asked = [timed.command for timed in process.commands if timed.t > at_s]
    return [
        command
        for command in asked
        if isinstance(command, ArmGoal | RelayPulse)
        or (isinstance(command, WheelsDrive) and (command.speed_m_s, command.yaw_rate_rad_s) != (0.0, 0.0))
    ]


@pytest.mark.parametrize(
    ("device", "for_s"),
    [
        ("relay", FOR_S),
        pytest.param("wheels", FOR_S, marks=pytest.mark.long),
        pytest.param("arm", FOR_S, marks=pytest.mark.long),
        pytest.param("camera", 9.0, marks=pytest.mark.long),  # needed at the next stop
    ],
)
def test_what_moves_or_sprays_ends_in_a_safe_stop_and_does_not_go_on(
    device: str, for_s: float, tmp_path: Path
) -> None:
    run = drive(tmp_path, f"{device}:unplugged@{UNPLUGGED_S}s+{for_s}s")
    assert run.mode == "safe_stop", run.said
    assert device in run.causes or (device == "relay" and "inputs" in run.causes)
    assert asked_after(run.process, UNPLUGGED_S + for_s) == []
    assert not run.after.valve_open_at_last or run.after.longest_opening_s <= 5.0
    assert run.booked_ml >= run.after.total_ml - 0.01


@pytest.mark.long
@pytest.mark.parametrize(("device", "for_s"), [("gps", FOR_S), ("modem", 11.0)])  # the modem is asked every 10 s
def test_the_mission_goes_on_without_what_only_informs(device: str, for_s: float, tmp_path: Path) -> None:
    run = drive(tmp_path, f"{device}:unplugged@{UNPLUGGED_S}s+{for_s}s")
    assert run.state == "done", run.said
    assert device in run.said
    assert run.booked_ml >= run.after.total_ml - 0.01
    assert run.after.total_ml > 1.0


@pytest.mark.long
def test_a_row_that_an_unplugged_relay_ended_is_finished_by_a_resume(tmp_path: Path) -> None:
    config = short_row(tmp_path)
    first = drive(tmp_path, f"relay:unplugged@{UNPLUGGED_S}s+{FOR_S}s", config=config)
    assert first.mode == "safe_stop"
    second = drive(tmp_path, more=("--resume",), config=config)
    assert second.state == "done", second.said
    assert second.booked_ml >= second.after.total_ml - 0.01

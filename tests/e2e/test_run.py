"""``sprayer run``: waiting, a whole row, the same row again, and going on after a stop or a kill."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import time
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from drivers.relay.values import Channel
from drivers.twin.aftermath import run_on
from drivers.twin.commands import ArmGoal, RelayPulse, RelaySwitch, WheelsDrive
from drivers.twin.truth_record import Delivered, ProcessTruth, TruthRecord, read_truth
from robot.cli import run_command
from robot.ledger import LedgerReader, Outcome, ShotRow, Totals
from robot.targets import Target, TargetState

from .rover_process import SPRAYER, begin, command, finish, load, short_row, wait_for_line, wait_for_message

STOPS_M = (0.45, 0.85, 1.25)
STOPS_WITHIN_M = 0.020
SPEED = "5"
OPENING = '"device":"relay","verb":"pulse","args":{"channel":"valve"'
MOVING = (ArmGoal, WheelsDrive, RelayPulse)


@dataclass(frozen=True, eq=False)
class Sprayed:
    """All that a run directory tells: the program's summary, its ledger, and the truth."""

    summary: dict[str, Any]
    shots: tuple[ShotRow, ...]
    targets: tuple[Target, ...]
    totals: Totals
    truth: TruthRecord

    @property
    def opened(self) -> tuple[ShotRow, ...]:
        return tuple(shot for shot in self.shots if shot.result and shot.result.outcome is not Outcome.NOT_OPENED)

    @property
    def figures(self) -> list[object]:
        """What was ordered and what came of it, without the times of day."""
        return [(shot.intent, shot.result) for shot in self.shots]

    @property
    def delivered_ml(self) -> float:
        return sum(delivered.ml for delivered in self.truth.delivered)


def spray_row(config: Path, out: Path, *more: str) -> Sprayed:
    """One run in this process, to the end of the row."""
    summary = out.parent / f"{out.name}.json"
    arguments = command(config, out, "--start", "--summary", str(summary), *more)[len(SPRAYER) :]
    assert run_command([*arguments] if "--speed" in more else [*arguments, "--speed", "0"]) == 0
    return read_run(out, load(summary))


def read_run(out: Path, summary: dict[str, Any]) -> Sprayed:
    with LedgerReader.open_read_only(out / "ledger.sqlite") as ledger:
        shots, targets, totals = ledger.shots(1), ledger.targets(1), ledger.totals(1)
    return Sprayed(summary, shots, targets, totals, read_truth(out / "truth.jsonl"))


@pytest.fixture(scope="module")
def row(tmp_path_factory: pytest.TempPathFactory) -> Sprayed:
    folder = tmp_path_factory.mktemp("row")
    return spray_row(short_row(folder, STOPS_M), folder / "out")


# --- waiting


def did_nothing(process: ProcessTruth) -> bool:
    switched_on = any(isinstance(timed.command, RelaySwitch) and timed.command.on for timed in process.commands)
    return not switched_on and not any(isinstance(timed.command, MOVING) for timed in process.commands)


def test_without_start_the_machine_comes_up_disarmed_and_waits_for_the_signal(tmp_path: Path) -> None:
    process = begin(short_row(tmp_path), tmp_path, "--summary", str(tmp_path / "summary.json"), "--speed", "50")
    told = wait_for_message(process, "up, disarmed, waiting")
    process.send_signal(signal.SIGTERM)
    code, errors = finish(process)
    assert code == 0, told + errors
    summary = load(tmp_path / "summary.json")
    assert (summary["state"], summary["mode"], summary["task"]) == ("idle", "disarmed", None)
    assert did_nothing(read_truth(tmp_path / "truth.jsonl").processes[-1])
    after = run_on(tmp_path / "truth.jsonl")
    assert after.base_pose == (0.0, 0.0, 0.0)
    assert after.total_ml == 0.0


def test_a_configuration_that_came_along_is_found_from_any_directory_and_the_keyboard_ends_it(tmp_path: Path) -> None:
    environment = os.environ | {"OPENBLAS_NUM_THREADS": "1"}
    process = subprocess.Popen(
        [*SPRAYER, "run", "--config", "demo.toml"], cwd=tmp_path, env=environment, stderr=subprocess.PIPE, text=True
    )
    told = wait_for_message(process, "up, disarmed, waiting")
    process.send_signal(signal.SIGINT)
    code, errors = finish(process)
    assert code == 0, told + errors
    assert (tmp_path / "out" / "ledger.sqlite").exists()


# --- a whole row


def test_a_row_is_sprayed_and_the_summary_says_so(row: Sprayed) -> None:
    summary = row.summary
    assert (summary["state"], summary["mode"], summary["causes"]) == ("done", "disarmed", [])
    assert (summary["task"], summary["dangling"], summary["pending_ml"]) == (1, [], 0)
    assert summary["targets"]["sprayed"] >= 3
    assert sum(summary["targets"].values()) == len(row.targets)
    assert summary["targets"]["open"] == 0
    assert summary["duration_s"] > 0.0


def test_the_ledger_covers_what_the_nozzle_gave_and_no_more_than_it_must(row: Sprayed) -> None:
    assert row.summary["booked_ml"] == pytest.approx(row.totals.booked_ml, abs=1e-3)
    assert row.delivered_ml > 0.0
    assert row.totals.booked_ml >= row.delivered_ml - 1e-6
    assert row.totals.booked_ml <= 1.05 * row.delivered_ml + 0.4


def test_every_opening_of_the_valve_is_a_shot_of_the_ledger(row: Sprayed) -> None:
    assert len(row.truth.delivered) == len(row.opened)
    for shot, delivered in zip(row.opened, row.truth.delivered, strict=True):
        assert delivered.ml == pytest.approx(shot.intent.dose_ml, rel=0.12, abs=0.2)


def test_no_fruit_is_sprayed_twice(row: Sprayed) -> None:
    assert max(aimed_at(row.truth).values()) == 1


def test_the_rover_ends_at_the_last_stop_with_everything_off(row: Sprayed) -> None:
    last = row.truth.processes[-1].states[-1]
    assert last.base[0] == pytest.approx(STOPS_M[-1], abs=STOPS_WITHIN_M)
    after = run_on(Path(row.summary["ledger"]).parent / "truth.jsonl")
    assert not any(after.coils.values())


@pytest.mark.parametrize("speed", ["0", "50"])
def test_the_same_seed_gives_the_same_run_to_the_last_bit_at_any_speed(
    tmp_path: Path, row: Sprayed, speed: str
) -> None:
    again = spray_row(short_row(tmp_path, STOPS_M), tmp_path / "out", "--speed", speed)
    assert again.figures == row.figures
    first = Path(row.summary["ledger"]).parent / "truth.jsonl"
    assert (tmp_path / "out" / "truth.jsonl").read_bytes() == first.read_bytes()


def test_another_seed_gives_another_greenhouse(tmp_path: Path, row: Sprayed) -> None:
    other = spray_row(short_row(tmp_path, STOPS_M[:1]), tmp_path / "out", "--seed", "7")
    assert other.truth.fruits != row.truth.fruits
    assert other.figures != row.figures


def test_a_value_of_the_environment_overrides_the_file(
    tmp_path: Path, row: Sprayed, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert max(shot.intent.dose_ml for shot in row.shots) > 3.0
    monkeypatch.setenv("SPRAYER_DOSING__MAX_ML", "2")
    modest = spray_row(short_row(tmp_path, STOPS_M[:1]), tmp_path / "out")
    assert max(shot.intent.dose_ml for shot in modest.shots) == 2.0
    assert max(delivered.ml for delivered in modest.truth.delivered) < 2.5


def test_a_signal_while_the_machine_comes_up_ends_it_clean(tmp_path: Path) -> None:
    process = begin(short_row(tmp_path, STOPS_M[:1]), tmp_path, "--start", "--speed", "1")
    wait_for_line(process, tmp_path / "truth.jsonl", '"kind":"world"')
    process.send_signal(signal.SIGTERM)
    code, errors = finish(process)
    assert code == 0, errors
    assert "stopped by SIGTERM" in errors
    after = run_on(tmp_path / "truth.jsonl")
    assert after.total_ml == 0.0
    assert not any(after.coils.values())


def test_a_signal_that_comes_when_the_row_is_done_does_not_change_the_outcome(tmp_path: Path) -> None:
    summary = tmp_path / "summary.json"
    process = begin(short_row(tmp_path, STOPS_M[:1]), tmp_path, "--start", "--summary", str(summary), "--speed", "0")
    wait_for_message(process, "row done")
    while process.poll() is None:
        process.send_signal(signal.SIGTERM)
        time.sleep(0.002)
    code, errors = finish(process)
    assert code == 0, errors
    assert load(summary)["state"] == "done"


# --- going on


def aimed_at(truth: TruthRecord) -> Counter[int]:
    """How many openings were aimed at each fruit: the one nearest to the nozzle's axis."""
    return Counter(_aimed(truth, delivered) for delivered in truth.delivered)


def _aimed(truth: TruthRecord, delivered: Delivered) -> int:
    axis = np.array(delivered.axis)

    def off_axis_m(centre_m: tuple[float, float, float]) -> float:
        way = np.array(centre_m) - delivered.nozzle_m
        along_m = float(way @ axis)
        return float(np.linalg.norm(way - along_m * axis)) if 0.0 < along_m < 0.6 else float("inf")

    return min(truth.fruits, key=lambda fruit: off_axis_m(fruit.centre_m)).id


def long_shots(folder: Path) -> Path:
    """A row whose shots take so long that a kill meets them in the middle, on a slow machine too."""
    return short_row(folder, STOPS_M, **{"min_ml = 1.5": "min_ml = 10.0"})


def stop_in_mid_row(config: Path, out: Path, number: signal.Signals, opening: int, *more: str) -> None:
    """A process that is sent the signal as its ``opening``-th opening of the valve has begun."""
    truth = out / "truth.jsonl"
    before = truth.read_text().count(OPENING) if truth.exists() else 0
    process = begin(config, out, "--start", "--speed", SPEED, *more)
    wait_for_line(process, truth, OPENING, count=before + opening)
    process.send_signal(number)
    code, errors = finish(process)
    assert code == (0 if number is signal.SIGTERM else -signal.SIGKILL), errors


def judge_resumed(sprayed: Sprayed, out: Path, end_m: float = STOPS_M[-1]) -> None:
    """The row is done, nothing got a second shot, and the ledger covers it all."""
    assert (sprayed.summary["state"], sprayed.summary["mode"]) == ("done", "disarmed")
    runs_of_target: dict[int, set[int]] = {}
    for shot in sprayed.opened:
        runs_of_target.setdefault(shot.intent.target_id, set()).add(shot.run_id)
    assert all(len(runs) == 1 for runs in runs_of_target.values()), runs_of_target
    assert max(aimed_at(sprayed.truth).values()) == 1
    after = run_on(out / "truth.jsonl")
    assert after.base_pose[0] == pytest.approx(end_m, abs=STOPS_WITHIN_M)
    assert not any(after.coils.values())
    assert sprayed.totals.pending_ml == 0.0
    assert sprayed.totals.booked_ml >= after.total_ml - 1e-6


def test_a_row_stopped_by_a_signal_is_finished_by_a_resume(tmp_path: Path) -> None:
    config, out = short_row(tmp_path, STOPS_M), tmp_path / "out"
    stop_in_mid_row(config, out, signal.SIGTERM, 2)
    before = read_run(out, {})
    sprayed = spray_row(config, out, "--resume")
    assert len(before.opened) >= 2
    assert len(sprayed.opened) > len(before.opened), "nothing was left for the resume"
    judge_resumed(sprayed, out)
    assert sprayed.figures[: len(before.shots)] == before.figures


def test_a_shot_cut_by_a_kill_is_reported_booked_in_full_and_never_repeated(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    config, out = long_shots(tmp_path), tmp_path / "out"
    stop_in_mid_row(config, out, signal.SIGKILL, 1)
    with LedgerReader.open_read_only(out / "ledger.sqlite") as ledger:
        (dangling,) = ledger.dangling()
    target = dangling.intent.target_id
    sprayed = spray_row(config, out, "--resume")
    told = capsys.readouterr().err
    assert told.count("booked as its full pulse") == 1
    assert f"the shot at target {target} had no outcome" in " ".join(told.split())
    assert [item["target_id"] for item in sprayed.summary["dangling"]] == [target]
    judge_resumed(sprayed, out)
    assert {t.id: t.state for t in sprayed.targets}[target] is TargetState.UNCERTAIN
    results = [shot.result for shot in sprayed.shots if shot.intent.target_id == target]
    assert [(result.outcome, result.booked_ml) for result in results if result] == [
        (Outcome.UNCERTAIN, dangling.intent.full_ml)
    ]


@pytest.mark.long
def test_a_resumed_row_can_be_killed_and_resumed_again(tmp_path: Path) -> None:
    config, out = long_shots(tmp_path), tmp_path / "out"
    stop_in_mid_row(config, out, signal.SIGTERM, 1)
    stop_in_mid_row(config, out, signal.SIGKILL, 1, "--resume")
    sprayed = spray_row(config, out, "--resume")
    assert len(sprayed.truth.processes) == 3
    judge_resumed(sprayed, out)


def test_a_row_killed_before_its_first_stop_is_resumed_from_where_it_stands(tmp_path: Path) -> None:
    config, out = short_row(tmp_path, STOPS_M[:1]), tmp_path / "out"
    process = begin(config, out, "--start", "--speed", SPEED)
    wait_for_line(process, out / "truth.jsonl", '"verb":"drive"', count=8)
    process.send_signal(signal.SIGKILL)
    finish(process)
    assert 0.0 < run_on(out / "truth.jsonl").base_pose[0] < STOPS_M[0]
    judge_resumed(spray_row(config, out, "--resume"), out, STOPS_M[0])


def test_resuming_a_row_that_is_done_sprays_nothing_again(tmp_path: Path, row: Sprayed) -> None:
    out = tmp_path / "out"
    shutil.copytree(Path(row.summary["ledger"]).parent, out)
    after = spray_row(short_row(tmp_path, STOPS_M), out, "--resume")
    judge_resumed(after, out)
    assert after.figures[: len(row.shots)] == row.figures


def test_the_valve_never_opens_without_a_board_timed_pulse(row: Sprayed) -> None:
    commands = [timed.command for timed in row.truth.processes[-1].commands]
    assert not any(isinstance(c, RelaySwitch) and c.on and c.channel in (Channel.VALVE, Channel.PUMP) for c in commands)

"""``sprayer spray``: what left the nozzle, what stands in the ledger, what a person was told."""

from __future__ import annotations

import io
import re
import subprocess
from pathlib import Path

import pytest

from drivers.twin.aftermath import run_on
from robot.cli import run_command
from robot.ledger import LedgerReader, Outcome
from robot.ledger.values import Task
from robot.targets import TargetState

from .by_hand import at_rest, command, process, shots, totals
from .rover_process import DEADLINE_S, DEMO, SPRAYER, short_row
from .rover_process import command as run_words
from .test_bad_input import USAGE, Told, refused

__all__ = ["refused"]

FAILED = 1


def spray(out: Path, ml: float, *more: str, config: Path = DEMO) -> int:
    return command(out, "spray", "--ml", str(ml), "--yes", *more, config=config)


def given_ml(out: Path) -> float:
    return run_on(out / "truth.jsonl").total_ml


@pytest.mark.parametrize("ml", [1.0, 5.0, 12.0])
def test_a_dose_leaves_the_nozzle_and_is_booked_just_above_it(tmp_path: Path, ml: float) -> None:
    out = tmp_path / "out"
    assert spray(out, ml) == 0
    assert given_ml(out) == pytest.approx(ml, rel=0.08, abs=0.1)
    assert given_ml(out) <= totals(out).booked_ml <= 1.05 * given_ml(out) + 0.17
    (shot,) = shots(out)
    assert shot.intent.due_ml == ml
    assert shot.result.outcome is Outcome.SPRAYED
    after = run_on(out / "truth.jsonl")
    assert not any(after.coils.values())


def test_it_says_what_was_commanded_booked_and_measured(tmp_path: Path, capsys) -> None:
    out = tmp_path / "out"
    assert spray(out, 4.0, "--times", "3") == 0
    told = re.findall(r"commanded (\S+) ml, booked (\S+) ml, measured (\S+) ml \(sprayed\)", capsys.readouterr().out)
    assert len(told) == 3
    assert [float(commanded) for commanded, _, _ in told] == [4.0, 4.0, 4.0]
    assert sum(float(booked) for _, booked, _ in told) == pytest.approx(totals(out).booked_ml, abs=0.02)
    assert sum(float(measured) for _, _, measured in told) == pytest.approx(totals(out).measured_ml, abs=0.02)
    assert given_ml(out) == pytest.approx(12.0, rel=0.08)


def test_the_task_says_product_operator_and_that_it_was_by_hand(tmp_path: Path) -> None:
    out = tmp_path / "out"
    assert spray(out, 4.0) == 0
    with LedgerReader.open_read_only(out / "ledger.sqlite") as ledger:
        task: Task = ledger.task(1)
        (target,) = ledger.targets(1)
        texts = [event.text for event in ledger.events("by_hand")]
    assert (task.product, task.operator, task.route, task.water) == ("water (demonstration)", "demo", "by hand", True)
    assert target.state is TargetState.SPRAYED
    assert target.confidence == 0.0
    assert "by hand" in target.reason
    assert texts == ["spray 4 ml"]


def test_the_place_in_the_ledger_is_where_the_nozzle_was(tmp_path: Path) -> None:
    out = tmp_path / "out"
    assert command(out, "jog", "joint", "waist", "0.3") == 0
    assert spray(out, 4.0) == 0
    with LedgerReader.open_read_only(out / "ledger.sqlite") as ledger:
        (target,) = ledger.targets(1)
    assert target.centre_m == pytest.approx(at_rest(out).nozzle_pose[:3, 3], abs=0.01)


def test_a_dose_that_one_opening_cannot_give_is_split(tmp_path: Path) -> None:
    out = tmp_path / "out"
    config = short_row(tmp_path, **{"min_ml = 1.5": "min_ml = 1.5\nmax_pulse_s = 0.5"})
    assert spray(out, 11.0, config=config) == 0
    assert [shot.intent.pulse for shot in shots(out)] == [1, 2]
    assert given_ml(out) == pytest.approx(11.0, rel=0.08)


def test_the_cap_of_a_minute_is_waited_for(tmp_path: Path, capsys) -> None:
    out = tmp_path / "out"
    config = short_row(tmp_path, **{"max_minute_ml = 200.0": "max_minute_ml = 30.0"})
    assert spray(out, 10.0, "--times", "5", config=config) == 0
    assert "no more than 30 ml in a minute" in capsys.readouterr().err
    stamps = [(shot.result.stamp_s, shot.result.booked_ml) for shot in shots(out)]
    for stamp_s, _ in stamps:
        assert sum(ml for when_s, ml in stamps if stamp_s - 60.0 < when_s <= stamp_s) <= 30.0
    assert given_ml(out) == pytest.approx(50.0, rel=0.08)


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("--ml", "13"), ("13 ml is over dosing.max_ml, 12 ml",)),
        (("--ml", "100"), ("100 ml is over safety.max_shot_ml, 15 ml",)),
        (("--ml", "0.2"), ("0.20 ml cannot be given",)),
        (("--ml", "0"), ("above 0, found 0",)),
        (("--ml", "-3"), ("above 0, found -3",)),
        (("--ml", "nan"), ("above 0, found nan",)),
        (("--ml", "inf"), ("above 0, found inf",)),
        (("--ml", "5", "--times", "0"), ("--times",)),
        (("--ml", "5", "--times", "101"), ("--times",)),
        ((), ("--ml",)),
    ],
)
def test_a_silly_dose_is_refused_and_nothing_is_sprayed(tmp_path: Path, refused: Told, words, told) -> None:
    refused(command(tmp_path / "out", "spray", "--yes", *words), USAGE, *told)
    assert not (tmp_path / "out" / "truth.jsonl").exists()


def test_more_than_label_and_tank_allow_is_refused(tmp_path: Path, refused: Told) -> None:
    config = short_row(tmp_path, **{"label_cap_ml = 2000.0": "label_cap_ml = 50.0"})
    refused(spray(tmp_path / "out", 10.0, "--times", "6", config=config), USAGE, "label and tank allow 50 ml in all")
    assert not (tmp_path / "out" / "truth.jsonl").exists()


@pytest.mark.parametrize("answer", ["", "no\n", "YES\n", "y\n"])
def test_nothing_is_sprayed_unless_yes_is_typed(tmp_path: Path, refused: Told, monkeypatch, capsys, answer) -> None:
    monkeypatch.setattr("sys.stdin", io.StringIO(answer))
    code = command(tmp_path / "out", "spray", "--ml", "5")
    assert code == USAGE
    told = capsys.readouterr()
    assert "5 ml of water (demonstration)" in told.out
    assert "not confirmed" in told.err
    assert not (tmp_path / "out" / "truth.jsonl").exists()


def test_a_typed_yes_from_a_pipe_sprays(tmp_path: Path) -> None:
    out = tmp_path / "out"
    out.mkdir()
    words = ["spray", "--ml", "3", "--config", str(DEMO), "--out", str(out), "--truth", str(out / "truth.jsonl")]
    done = subprocess.run(
        [*SPRAYER, *words, "--speed", "0"], input="yes\n", capture_output=True, text=True, timeout=DEADLINE_S,
        check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert given_ml(out) == pytest.approx(3.0, rel=0.08, abs=0.1)


def test_a_clogged_nozzle_stops_the_series_and_says_so(tmp_path: Path, capsys) -> None:
    out = tmp_path / "out"
    assert spray(out, 5.0, "--times", "4", "--fault", "valve:off@3.2s") == FAILED
    told = capsys.readouterr()
    assert "flow meter saw" in told.err
    assert "uncertain" in told.out
    assert "not begun:" in told.out
    assert totals(out).booked_ml >= given_ml(out)
    assert shots(out)[-1].result.outcome is Outcome.UNCERTAIN


def test_an_empty_tank_gives_nothing(tmp_path: Path, capsys) -> None:
    out = tmp_path / "out"
    config = short_row(tmp_path, **{"tank_fill_ml = 8000.0": "tank_fill_ml = 206.0"})
    assert spray(out, 4.0, config=config) == FAILED
    assert "the tank holds" in capsys.readouterr().err
    assert given_ml(out) == 0.0


def test_without_pressure_it_is_not_sprayed(tmp_path: Path, capsys) -> None:
    out = tmp_path / "out"
    config = short_row(tmp_path, **{"pump_pressure_bar = 2.76": "pump_pressure_bar = 2.76\npressure_timeout_s = 0.5"})
    assert spray(out, 4.0, config=config) == 69
    assert "pump: expected 2.48 bar within 0.5 s" in capsys.readouterr().err
    assert given_ml(out) == 0.0
    assert not any(run_on(out / "truth.jsonl").coils.values())


def test_a_row_that_is_resumed_passes_over_what_was_sprayed_by_hand_in_between(tmp_path: Path, capsys) -> None:
    out = tmp_path / "out"
    config = short_row(tmp_path, (0.45,))
    assert run_command(run_words(config, out, "--start", "--speed", "0")[len(SPRAYER) :]) == 0
    assert spray(out, 4.0, config=config) == 0
    summary = tmp_path / "summary.json"
    more = ("--start", "--resume", "--speed", "0", "--summary", str(summary))
    assert run_command(run_words(config, out, *more)[len(SPRAYER) :]) == 0
    assert '"task": 1' in summary.read_text()


def test_a_report_of_a_task_by_hand_can_be_made(tmp_path: Path, capsys) -> None:
    out = tmp_path / "out"
    assert spray(out, 4.0) == 0
    assert run_command(["report", str(out / "ledger.sqlite"), "--truth", str(out / "truth.jsonl")]) == 0
    assert "by hand" in (out / "report.html").read_text()
    assert process(out).delivered[0].ml == pytest.approx(4.0, rel=0.1)

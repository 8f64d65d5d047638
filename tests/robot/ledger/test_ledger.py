"""What is written can be read back, once; what breaks a rule is not written at all."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from dataclasses import replace
from datetime import UTC, datetime, timedelta, timezone
from pathlib import Path

import numpy as np
import pytest

from robot.errors import FileError
from robot.ledger import Ledger, LedgerReader, LedgerRuleError, Outcome, Result
from robot.targets import TargetState
from tests.robot.ledger.rows import CHECKPOINT, INTENT, LIGHT, NOON, SPRAYED, STOP, TASK, intent, started, target

Opened = tuple[Ledger, int]


@pytest.fixture
def opened(tmp_path: Path) -> Iterator[Opened]:
    ledger, task_id = started(tmp_path / "run.ledger")
    yield ledger, task_id
    ledger.close()


def test_a_task_comes_back_as_it_was_written(opened: Opened) -> None:
    ledger, task_id = opened
    assert ledger.task(task_id) == TASK
    assert ledger.latest_task() == task_id
    other = ledger.begin_task(replace(TASK, seed=None, water=False))
    assert ledger.task(other) == replace(TASK, seed=None, water=False)
    assert [row.task_id for row in ledger.tasks()] == [task_id, other]
    assert ledger.tasks()[0].utc == NOON


def test_an_unknown_task_is_named(opened: Opened) -> None:
    with pytest.raises(FileError, match="has no task 99; its newest is 1"):
        opened[0].task(99)


def test_an_empty_ledger_has_no_task(tmp_path: Path) -> None:
    with Ledger.open(tmp_path / "new.ledger") as ledger:
        assert ledger.latest_task() is None
        assert ledger.dangling() == ()


def test_intent_and_result_come_back_as_one_shot(opened: Opened) -> None:
    ledger, task_id = opened
    number = ledger.write_intent(task_id, INTENT)
    ledger.write_result(number, SPRAYED)
    (shot,) = ledger.shots(task_id)
    assert (shot.intent_id, shot.intent, shot.result, shot.utc, shot.result_utc) == (
        number,
        INTENT,
        SPRAYED,
        NOON,
        NOON,
    )


def test_an_intent_is_durable_before_the_call_returns(opened: Opened) -> None:
    ledger, task_id = opened
    ledger.write_intent(task_id, INTENT)
    with LedgerReader.open_read_only(ledger.path) as reader:
        assert [item.intent for item in reader.dangling()] == [INTENT]
    with sqlite3.connect(ledger.path) as other:
        assert other.execute("PRAGMA journal_mode").fetchone() == ("wal",)
    other.close()


def test_every_commit_is_synced_to_the_disk(opened: Opened) -> None:
    assert opened[0]._connection.execute("PRAGMA synchronous").fetchone() == (2,)
    assert opened[0]._connection.execute("PRAGMA foreign_keys").fetchone() == (1,)


def test_a_second_result_for_one_intent_is_refused_and_the_first_stays(opened: Opened) -> None:
    ledger, task_id = opened
    number = ledger.write_intent(task_id, INTENT)
    ledger.write_result(number, SPRAYED)
    with pytest.raises(LedgerRuleError):
        ledger.write_result(number, replace(SPRAYED, booked_ml=0.1))
    assert ledger.totals(task_id).booked_ml == 5.0


def test_a_result_without_an_intent_is_refused(opened: Opened) -> None:
    with pytest.raises(LedgerRuleError, match="FOREIGN KEY"):
        opened[0].write_result(12345, SPRAYED)


def test_an_intent_for_a_target_that_is_not_in_the_ledger_is_refused(opened: Opened) -> None:
    ledger, task_id = opened
    with pytest.raises(LedgerRuleError, match="FOREIGN KEY"):
        ledger.write_intent(task_id, intent(99))


@pytest.mark.parametrize(
    "changes",
    [
        {"dose_ml": -1.0}, {"full_ml": float("nan")}, {"full_ml": float("inf")}, {"open_s": 0.0}, {"pulse_s": 1e9},
        {"factor": 2.5},
    ],
)
def test_an_intent_with_an_impossible_figure_is_refused(opened: Opened, changes: dict[str, float]) -> None:
    ledger, task_id = opened
    with pytest.raises(LedgerRuleError):
        ledger.write_intent(task_id, replace(INTENT, **changes))
    assert ledger.shots(task_id) == ()


@pytest.mark.parametrize(
    "wrong",
    [
        replace(SPRAYED, booked_ml=-0.1),
        replace(SPRAYED, outcome=Outcome.NOT_OPENED, booked_ml=1.0),
        replace(SPRAYED, booked_ml=float("nan")),
    ],
)
def test_a_result_with_an_impossible_figure_is_refused_and_the_intent_stays_open(opened: Opened, wrong: Result) -> None:
    ledger, task_id = opened
    number = ledger.write_intent(task_id, INTENT)
    with pytest.raises(LedgerRuleError):
        ledger.write_result(number, wrong)
    assert len(ledger.dangling()) == 1


def test_history_cannot_be_rewritten_even_by_another_program(opened: Opened) -> None:
    ledger, task_id = opened
    number = ledger.write_intent(task_id, INTENT)
    ledger.write_result(number, SPRAYED)
    other = sqlite3.connect(ledger.path, isolation_level=None)
    for statement in (
        "UPDATE intent SET full_ml = 0",
        "DELETE FROM intent",
        "UPDATE result SET booked_ml = 0",
        "DELETE FROM result",
    ):
        with pytest.raises(sqlite3.IntegrityError, match=r"final|stays"):
            other.execute(statement)
    other.close()


def test_totals_are_booked_pending_measured_and_pulses_by_outcome(opened: Opened) -> None:
    ledger, task_id = opened
    for target_id, outcome, booked_ml, measured_ml in (
        (1, Outcome.SPRAYED, 5.0, 4.9),
        (3, Outcome.SHORTENED, 2.0, None),
        (1, Outcome.NOT_OPENED, 0.0, 0.0),
    ):
        number = ledger.write_intent(task_id, intent(target_id))
        ledger.write_result(number, replace(SPRAYED, outcome=outcome, booked_ml=booked_ml, measured_ml=measured_ml))
    ledger.write_intent(task_id, intent(2))
    totals = ledger.totals(task_id)
    assert (totals.booked_ml, totals.pending_ml, totals.measured_ml) == (7.0, 6.3, 4.9)
    assert {kind: count for kind, count in totals.pulses.items() if count} == {
        Outcome.SPRAYED: 1,
        Outcome.SHORTENED: 1,
        Outcome.NOT_OPENED: 1,
    }


def test_dangling_intents_are_booked_as_the_full_pulse_and_their_targets_as_uncertain(opened: Opened) -> None:
    ledger, task_id = opened
    closed = ledger.write_intent(task_id, intent(1))
    ledger.write_result(closed, SPRAYED)
    left = ledger.write_intent(task_id, intent(2))
    found = ledger.book_dangling(NOON + timedelta(hours=1))
    assert [(item.intent_id, item.task_id, item.intent.target_id) for item in found] == [(left, task_id, 2)]
    shot = ledger.shots(task_id)[1]
    assert shot.result is not None
    assert (shot.result.outcome, shot.result.booked_ml, shot.result.open_s) == (Outcome.UNCERTAIN, 6.3, 0.5)
    assert shot.result_utc == NOON + timedelta(hours=1)
    assert [t.state for t in ledger.targets(task_id)] == [
        TargetState.SPRAYED,
        TargetState.UNCERTAIN,
        TargetState.OPEN,
    ]
    assert ledger.book_dangling(NOON) == ()


def test_targets_come_back_as_they_were_written(opened: Opened) -> None:
    ledger, task_id = opened
    changed = replace(
        target(2, TargetState.UNREACHABLE, x_m=0.61),
        reason="out of the arm's reach", sightings=3, measured=False, ripeness_weight=2.1,
    )  # fmt: skip
    ledger.upsert_targets(task_id, [changed, target(4)])
    read = {item.id: item for item in ledger.targets(task_id)}
    assert sorted(read) == [1, 2, 3, 4]
    np.testing.assert_array_equal(read[2].centre_m, changed.centre_m)
    np.testing.assert_array_equal(read[2].covariance_m2, changed.covariance_m2)
    for name in (
        "diameter_m", "diameter_sigma_m", "ripeness", "ripeness_score", "ripeness_weight", "confidence",
        "visible_fraction", "measured",
    ):  # fmt: skip
        assert getattr(read[2], name) == getattr(changed, name)
    assert (read[2].state, read[2].reason, read[2].sightings) == (
        TargetState.UNREACHABLE,
        "out of the arm's reach",
        3,
    )


def test_of_a_batch_of_targets_all_or_none_is_written(opened: Opened) -> None:
    ledger, task_id = opened
    with pytest.raises(LedgerRuleError):
        ledger.upsert_targets(task_id, [target(4), replace(target(5), diameter_m=float("nan"))])
    assert [item.id for item in ledger.targets(task_id)] == [1, 2, 3]


@pytest.mark.parametrize(
    ("result", "state"),
    [
        (SPRAYED, TargetState.SPRAYED),
        (replace(SPRAYED, outcome=Outcome.SHORTENED), TargetState.UNCERTAIN),
        (None, TargetState.UNCERTAIN),
        (replace(SPRAYED, outcome=Outcome.NOT_OPENED, booked_ml=0.0), TargetState.OPEN),
    ],
)
def test_a_target_for_which_the_valve_opened_is_never_read_back_as_open(
    opened: Opened, result: Result | None, state: TargetState
) -> None:
    ledger, task_id = opened
    number = ledger.write_intent(task_id, INTENT)
    if result is not None:
        ledger.write_result(number, result)
    assert ledger.targets(task_id)[0].state is state


def test_the_newest_checkpoint_counts(opened: Opened) -> None:
    ledger, task_id = opened
    assert ledger.last_checkpoint(task_id) is None
    ledger.checkpoint(task_id, replace(CHECKPOINT, stop=2))
    ledger.checkpoint(task_id, CHECKPOINT)
    assert ledger.last_checkpoint(task_id) == CHECKPOINT


def test_stops_and_events_come_back_in_order(opened: Opened) -> None:
    ledger, task_id = opened
    ledger.record_stop(task_id, STOP)
    ledger.record_stop(task_id, replace(STOP, stop=3, light=LIGHT))
    ledger.record_event("state", "MOVE", 1.0)
    ledger.record_event("fault", "bumper pressed", 2.0)
    assert [row.record for row in ledger.stops(task_id)] == [STOP, replace(STOP, stop=3, light=LIGHT)]
    assert [(row.kind, row.text, row.stamp_s) for row in ledger.events()] == [
        ("state", "MOVE", 1.0),
        ("fault", "bumper pressed", 2.0),
    ]
    assert [row.text for row in ledger.events("fault")] == ["bumper pressed"]


def test_nothing_is_written_before_a_run_has_begun(tmp_path: Path) -> None:
    with Ledger.open(tmp_path / "new.ledger") as ledger, pytest.raises(LedgerRuleError, match="begin_run"):
        ledger.begin_task(TASK)


def test_a_time_without_zone_is_refused_and_another_zone_is_kept_as_utc(opened: Opened) -> None:
    ledger, task_id = opened
    with pytest.raises(LedgerRuleError, match="zone"):
        ledger.begin_run("boot-2", datetime(2026, 6, 1, 12, 0))  # noqa: DTZ001
    ledger.write_intent(task_id, INTENT)
    ledger.book_dangling(datetime(2026, 6, 1, 14, 0, tzinfo=timezone(timedelta(hours=2))))
    assert ledger.shots(task_id)[0].result_utc == datetime(2026, 6, 1, 12, 0, tzinfo=UTC)


def test_a_closed_ledger_says_so(tmp_path: Path) -> None:
    ledger, task_id = started(tmp_path / "run.ledger")
    ledger.close()
    with pytest.raises(FileError, match="closed"):
        ledger.write_intent(task_id, INTENT)

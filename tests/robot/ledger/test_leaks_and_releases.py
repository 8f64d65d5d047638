"""Leaks have rows of their own; an uncertain target waits for an operator's word, and that word is kept."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from robot.ledger import Leak, Ledger, LedgerReader, LedgerRuleError, MeterMark, Outcome, Result
from robot.targets import TargetState
from tests.robot.ledger.rows import INTENT, NOON, SPRAYED, intent, started, target

UNCERTAIN = Result(Outcome.UNCERTAIN, 6.3, 0.5, None, "close unconfirmed", 13.0)
SHORTENED = Result(Outcome.SHORTENED, 2.0, 0.1, 1.9, "shortened: a stop", 13.0)
LEAK = Leak(booked_ml=0.17, measured_ml=0.16, reason="flow past the shut valve", stamp_s=20.0)

Opened = tuple[Ledger, int]


@pytest.fixture
def opened(tmp_path: Path) -> Iterator[Opened]:
    ledger, task_id = started(tmp_path / "run.ledger")
    yield ledger, task_id
    ledger.close()


def shoot(ledger: Ledger, task_id: int, target_id: int, result: Result) -> int:
    number = ledger.write_intent(task_id, intent(target_id))
    ledger.write_result(number, result)
    return number


def state_of(reader: LedgerReader, task_id: int, target_id: int) -> TargetState:
    return next(item.state for item in reader.targets(task_id) if item.id == target_id)


def again(ledger: Ledger) -> Ledger:
    """The next run of the program."""
    ledger.close()
    after = Ledger.open(ledger.path, utc=lambda: NOON)
    after.begin_run("boot-2", NOON)
    after.book_dangling(NOON)
    return after


def test_leaks_come_back_in_order_and_count_in_the_totals_of_their_task(opened: Opened) -> None:
    ledger, task_id = opened
    shoot(ledger, task_id, 1, SPRAYED)
    numbers = [
        ledger.write_leak(task_id, LEAK),
        ledger.write_leak(task_id, replace(LEAK, stamp_s=21.0)),
        ledger.write_leak(None, LEAK),
    ]
    assert [row.id for row in ledger.leaks()] == numbers
    assert [(row.leak.stamp_s, row.task_id, row.utc) for row in ledger.leaks(task_id)] == [
        (20.0, task_id, NOON),
        (21.0, task_id, NOON),
    ]
    totals = ledger.totals(task_id)
    assert totals.leaked_ml == pytest.approx(0.34)
    assert totals.booked_ml == pytest.approx(5.34)
    assert totals.measured_ml == pytest.approx(4.9 + 0.32)


def test_a_leak_of_an_impossible_amount_is_refused(opened: Opened) -> None:
    ledger, task_id = opened
    with pytest.raises(LedgerRuleError):
        ledger.write_leak(task_id, replace(LEAK, booked_ml=-1.0))
    assert ledger.leaks() == ()


def test_leaks_and_releases_cannot_be_rewritten(opened: Opened) -> None:
    ledger, task_id = opened
    ledger.write_leak(task_id, LEAK)
    shoot(ledger, task_id, 1, UNCERTAIN)
    ledger.release_target(task_id, 1, "Ada", "looked at it: dry")
    other = sqlite3.connect(ledger.path, isolation_level=None)
    for statement in (
        "UPDATE leak SET booked_ml = 0",
        "DELETE FROM leak",
        "UPDATE release SET operator = 'Eve'",
        "DELETE FROM release",
    ):
        with pytest.raises(sqlite3.IntegrityError, match=r"final|stays"):
            other.execute(statement)
    other.close()


@pytest.mark.parametrize("result", [UNCERTAIN, SHORTENED])
def test_a_target_of_which_nobody_knows_what_it_got_takes_no_intent(opened: Opened, result: Result) -> None:
    ledger, task_id = opened
    shoot(ledger, task_id, 1, result)
    with pytest.raises(LedgerRuleError, match=r"target 1 of task 1 is uncertain.*operator must release"):
        ledger.write_intent(task_id, INTENT)
    assert len(ledger.shots(task_id)) == 1
    assert shoot(ledger, task_id, 2, SPRAYED) == 2


def test_nor_does_one_whose_outcome_is_still_to_be_written(opened: Opened) -> None:
    ledger, task_id = opened
    ledger.write_intent(task_id, INTENT)
    with pytest.raises(LedgerRuleError, match="is uncertain"):
        ledger.write_intent(task_id, INTENT)


def test_nor_does_one_that_got_a_part_of_its_dose_and_is_marked(opened: Opened) -> None:
    ledger, task_id = opened
    shoot(ledger, task_id, 1, SPRAYED)
    ledger.upsert_targets(task_id, [target(1, TargetState.UNCERTAIN)])
    with pytest.raises(LedgerRuleError, match="is uncertain"):
        ledger.write_intent(task_id, INTENT)


def test_a_dangling_target_stays_uncertain_over_restarts_whatever_a_book_says(opened: Opened) -> None:
    ledger, task_id = opened
    ledger.write_intent(task_id, INTENT)
    for _ in range(3):
        ledger = again(ledger)
        ledger.upsert_targets(task_id, [target(1, TargetState.OPEN)])  # a book that knows nothing of it
        assert state_of(ledger, task_id, 1) is TargetState.UNCERTAIN
        with pytest.raises(LedgerRuleError, match="is uncertain"):
            ledger.write_intent(task_id, INTENT)
    assert ledger.totals(task_id).booked_ml == pytest.approx(6.3)
    ledger.close()


def test_an_operators_release_makes_it_open_for_good_and_is_kept(opened: Opened) -> None:
    ledger, task_id = opened
    last = shoot(ledger, task_id, 1, UNCERTAIN)
    number = ledger.release_target(task_id, 1, "Ada", "looked at it: dry")
    ledger = again(ledger)
    (released,) = ledger.targets(task_id)[:1]
    assert (released.state, released.reason) == (TargetState.OPEN, "released by Ada: looked at it: dry")
    (row,) = ledger.releases(task_id)
    assert (row.id, row.target_id, row.operator, row.reason, row.last_intent_id, row.utc) == (
        number,
        1,
        "Ada",
        "looked at it: dry",
        last,
        NOON,
    )
    shoot(ledger, task_id, 1, SPRAYED)
    assert state_of(ledger, task_id, 1) is TargetState.SPRAYED
    assert ledger.totals(task_id).booked_ml == pytest.approx(11.3)  # what it may have got still counts
    ledger.close()


def test_a_release_does_not_speak_of_later_shots(opened: Opened) -> None:
    ledger, task_id = opened
    shoot(ledger, task_id, 1, UNCERTAIN)
    ledger.release_target(task_id, 1, "Ada", "dry")
    shoot(ledger, task_id, 1, UNCERTAIN)
    assert state_of(ledger, task_id, 1) is TargetState.UNCERTAIN
    with pytest.raises(LedgerRuleError, match="is uncertain"):
        ledger.write_intent(task_id, INTENT)
    ledger.release_target(task_id, 1, "Ada", "still dry")
    assert state_of(ledger, task_id, 1) is TargetState.OPEN


def test_only_an_uncertain_target_with_an_outcome_is_released_and_by_somebody(opened: Opened) -> None:
    ledger, task_id = opened
    shoot(ledger, task_id, 2, SPRAYED)
    ledger.write_intent(task_id, intent(3))
    ledger.upsert_targets(task_id, [target(1, TargetState.UNCERTAIN)])
    for target_id, why in (
        (99, "has no target 99"),
        (2, "target 2 of task 1 is sprayed; only an uncertain one"),
        (3, "target 3 of task 1 has no shot with an outcome"),
        (1, "target 1 of task 1 has no shot with an outcome"),
    ):
        with pytest.raises(LedgerRuleError, match=why):
            ledger.release_target(task_id, target_id, "Ada", "dry")
    ledger.write_result(2, UNCERTAIN)
    for operator, reason in (("", "dry"), ("Ada", "")):
        with pytest.raises(LedgerRuleError):
            ledger.release_target(task_id, 3, operator, reason)
    assert ledger.releases(task_id) == ()


def test_the_meters_mark_moves_with_the_rows_that_book_up_to_it(opened: Opened) -> None:
    ledger, task_id = opened
    assert ledger.meter_mark() is None
    ledger.mark_meter(None, 3.0)
    assert ledger.meter_mark() == MeterMark(None, 3.0, 0.0)
    counted = ledger.write_intent(task_id, intent(1))
    assert ledger.meter_mark() == MeterMark(None, 3.0, 6.3)  # its outcome is open
    ledger.write_result(counted, SPRAYED, 7.9)
    assert ledger.meter_mark() == MeterMark(task_id, 7.9, 0.0)
    shoot(ledger, task_id, 2, SPRAYED)  # nobody read the meter
    assert ledger.meter_mark() == MeterMark(task_id, 7.9, 5.0)
    ledger.write_leak(task_id, LEAK, 13.1)
    assert ledger.meter_mark() == MeterMark(task_id, 13.1, 0.0)

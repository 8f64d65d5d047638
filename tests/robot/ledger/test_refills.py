"""A refill is read back to the last bit, and what was booked since is counted by run and loop time, not by dates."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import pytest

from robot.ledger import Leak, Ledger, LedgerRuleError, Refill
from tests.robot.ledger.rows import NOON, SPRAYED, TASK, intent, started, target

ODD_ML = 5000.000000000001
LEAK = Leak(booked_ml=0.25, measured_ml=0.2, reason="flow past the shut valve", stamp_s=20.0)


def shoot(ledger: Ledger, task_id: int, target_id: int, stamp_s: float, *, closed: bool = True) -> None:
    number = ledger.write_intent(task_id, replace(intent(target_id), stamp_s=stamp_s))
    if closed:
        ledger.write_result(number, SPRAYED)


def test_the_newest_refill_of_a_task_counts_and_not_that_of_another(tmp_path: Path) -> None:
    ledger, task_id = started(tmp_path / "run.ledger")
    with ledger:
        assert ledger.last_refill(task_id) is None
        ledger.write_refill(task_id, 3000.0, "first", 10.0)
        ledger.write_refill(task_id, ODD_ML, "it said “full”; {so}", 11.1)
        other = ledger.begin_task(TASK)
        assert ledger.last_refill(other) is None
        ledger.write_refill(other, 1.0, "", 12.0)
        refill = ledger.last_refill(task_id)
    assert refill == Refill(task_id, ODD_ML, "it said “full”; {so}", 1, 11.1)


def test_shots_of_every_kind_and_leaks_since_then_are_booked_against_it_over_a_restart_too(tmp_path: Path) -> None:
    ledger, task_id = started(tmp_path / "run.ledger")
    shoot(ledger, task_id, 1, 19.0)
    ledger.write_leak(task_id, replace(LEAK, stamp_s=19.5))
    ledger.write_refill(task_id, ODD_ML, "test", 20.0)
    refill = ledger.last_refill(task_id)
    assert refill is not None
    assert ledger.booked_since_ml(refill) == 0.0
    shoot(ledger, task_id, 2, 21.0)
    assert ledger.booked_since_ml(refill) == 5.0
    shoot(ledger, task_id, 3, 22.0, closed=False)
    assert ledger.booked_since_ml(refill) == 5.0 + 6.3  # in full, as long as nobody knows better
    ledger.close()
    with Ledger.open(ledger.path, utc=lambda: NOON) as after:  # its clock begins at 0 again, the date never went on
        after.begin_run("boot-2", NOON)
        after.book_dangling(NOON)
        assert after.booked_since_ml(refill) == 5.0 + 6.3
        by_hand = after.begin_task(replace(TASK, route="by hand"))
        after.upsert_targets(by_hand, [target(1)])
        shoot(after, by_hand, 1, 1.0)
        after.write_leak(None, replace(LEAK, stamp_s=2.0))
        assert after.booked_since_ml(refill) == 5.0 + 6.3 + 5.0 + 0.25
        assert after.last_refill(task_id) == refill


@pytest.mark.parametrize("tank_ml", [0.0, -1.0, math.nan, math.inf])
def test_a_refill_of_nothing_is_refused_and_leaves_no_row(tank_ml: float, tmp_path: Path) -> None:
    ledger, task_id = started(tmp_path / "run.ledger")
    with ledger:
        with pytest.raises(LedgerRuleError, match="more than 0 ml"):
            ledger.write_refill(task_id, tank_ml, "test", 10.0)
        assert ledger.last_refill(task_id) is None


def test_the_last_event_of_a_kind_is_that_of_the_newest_run(tmp_path: Path) -> None:
    ledger, _ = started(tmp_path / "run.ledger")
    assert ledger.last_event("mode") is None
    ledger.record_event("mode", "auto", 50.0)
    ledger.close()
    with Ledger.open(ledger.path, utc=lambda: NOON) as after:
        after.begin_run("boot-2", NOON)
        after.record_event("mode", "safe_stop enough", 1.0)
        after.record_event("state", "idle", 2.0)
        last = after.last_event("mode")
    assert last is not None
    assert (last.run_id, last.kind, last.text, last.stamp_s, last.utc) == (2, "mode", "safe_stop enough", 1.0, NOON)

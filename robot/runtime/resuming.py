"""Which task of the ledger a resumed run goes on with."""

from __future__ import annotations

from datetime import datetime
from pathlib import Path

from robot import safety
from robot.errors import ConfigError, UsageError
from robot.ledger import Ledger
from robot.ledger.values import Task

BY_HAND = "by hand"  # the route of tasks that no row belongs to


def check_resumable(ledger: Path) -> None:
    """``UsageError`` where there is no ledger yet, before one is made."""
    if not ledger.exists():
        raise UsageError(f"{ledger}: there is no ledger to resume from; start without --resume, or give its --out")


def task_to_resume(ledger: Ledger, task: Task) -> int:
    """The newest task of a row. ``UsageError`` without one, ``ConfigError`` when it was begun with other values."""
    rows = [row.task_id for row in ledger.tasks() if ledger.task(row.task_id).route != BY_HAND]
    if not rows:
        raise UsageError(f"{ledger.path}: holds no task to resume; start without --resume")
    task_id = rows[-1]
    before = ledger.task(task_id)
    if before.config_hash != task.config_hash:
        raise ConfigError(
            f"{ledger.path}: task {task_id} was begun with another configuration "
            f"({before.config_hash}, now {task.config_hash}); restore it, or start without --resume"
        )
    return task_id


def taken_by_hand_ml(ledger: Ledger, task_id: int) -> float:
    """What was sprayed by hand since the task began: it is gone from the tank."""
    later = [row.task_id for row in ledger.tasks() if row.task_id > task_id]
    return sum(ledger.totals(number).booked_ml for number in later if ledger.task(number).route == BY_HAND)


def tank_left_ml(ledger: Ledger, task_id: int, fill_ml: float, given_ml: float) -> float:
    """The tank's balance: the newest refill of the task less everything booked since, or else what was filled in at its
    start, ``fill_ml``, less what it gave, ``given_ml``, and what was sprayed by hand since."""
    refill = ledger.last_refill(task_id)
    if refill is not None:
        return refill.tank_ml - ledger.booked_since_ml(refill)
    return fill_ml - given_ml - taken_by_hand_ml(ledger, task_id)


def given_before(ledger: Ledger, task_id: int, utc: datetime, now_s: float) -> safety.Given:
    """What counts for the caps of a task that begins or goes on at ``utc``, which is ``now_s`` on the loop's clock.

    Shots of every earlier run, those without an outcome in full, and leaks.
    """
    sums = ledger.sums(task_id, utc)
    return safety.Given(
        sums.task_ml, sums.day_ml, tuple(sorted(sums.target_ml.items())), tuple(sorted(sums.cell_ml.items())),
        tuple((now_s - entry.age_s, entry.ml) for entry in sums.minute),
    )  # fmt: skip

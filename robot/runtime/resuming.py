"""Which task of the ledger a resumed run goes on with."""

from __future__ import annotations

from pathlib import Path

from robot.errors import ConfigError, UsageError
from robot.ledger import Ledger
from robot.ledger.values import Task
from robot.mission.spray import cell_of
from robot.safety import Cell
from robot.targets import Book

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


def given_by_target_ml(ledger: Ledger, task_id: int) -> dict[int, float]:
    """What the task booked on each target so far; a shot without an outcome counts as its full pulse."""
    given_ml: dict[int, float] = {}
    for shot in ledger.shots(task_id):
        booked_ml = shot.result.booked_ml if shot.result else shot.intent.full_ml
        given_ml[shot.intent.target_id] = given_ml.get(shot.intent.target_id, 0.0) + booked_ml
    return given_ml


def cells_ml(book: Book, given_ml: dict[int, float]) -> tuple[tuple[Cell, float], ...]:
    """What was booked on the targets of each square metre."""
    cells: dict[Cell, float] = {}
    for target in book.targets:
        if target.id in given_ml:
            cells[cell_of(target)] = cells.get(cell_of(target), 0.0) + given_ml[target.id]
    return tuple(sorted(cells.items()))

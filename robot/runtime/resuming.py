"""Which task of the ledger a resumed run goes on with."""

from __future__ import annotations

from pathlib import Path

from robot.errors import ConfigError, UsageError
from robot.ledger import Ledger
from robot.ledger.values import Task


def check_resumable(ledger: Path) -> None:
    """``UsageError`` where there is no ledger yet, before one is made."""
    if not ledger.exists():
        raise UsageError(f"{ledger}: there is no ledger to resume from; start without --resume, or give its --out")


def task_to_resume(ledger: Ledger, task: Task) -> int:
    """The newest task. ``UsageError`` when there is none, ``ConfigError`` when it was begun with other values."""
    task_id = ledger.latest_task()
    if task_id is None:
        raise UsageError(f"{ledger.path}: holds no task to resume; start without --resume")
    before = ledger.task(task_id)
    if before.config_hash != task.config_hash:
        raise ConfigError(
            f"{ledger.path}: task {task_id} was begun with another configuration "
            f"({before.config_hash}, now {task.config_hash}); restore it, or start without --resume"
        )
    return task_id


def given_by_target_ml(ledger: Ledger, task_id: int) -> dict[int, float]:
    """What the task booked on each target so far; a shot without an outcome counts as its full pulse."""
    given_ml: dict[int, float] = {}
    for shot in ledger.shots(task_id):
        booked_ml = shot.result.booked_ml if shot.result else shot.intent.full_ml
        given_ml[shot.intent.target_id] = given_ml.get(shot.intent.target_id, 0.0) + booked_ml
    return given_ml

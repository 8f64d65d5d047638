"""What was given before this run: the figures that caps on liquid begin with, intents without an outcome included."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta

MINUTE = timedelta(minutes=1)

# One line for each shot and each leak: task, route, target (NULL for a leak), place, time, millilitres.
GIVEN = """
    SELECT task.id, task.route, target.id, target.x_m, target.y_m, coalesce(result.utc, intent.utc),
           coalesce(result.booked_ml, intent.full_ml)
    FROM intent JOIN task ON task.id = intent.task_id
    JOIN target ON target.task_id = intent.task_id AND target.id = intent.target_id
    LEFT JOIN result ON result.intent_id = intent.id
    WHERE intent.task_id = ?1 OR coalesce(result.utc, intent.utc) >= ?2
    UNION ALL
    SELECT leak.task_id, NULL, NULL, NULL, NULL, leak.utc, leak.booked_ml
    FROM leak WHERE leak.task_id = ?1 OR leak.utc >= ?2
"""

Cell = tuple[int, int]


@dataclass(frozen=True, slots=True)
class Given:
    """One shot or leak. ``target_id`` and place (row frame of ``route``, metres) are None for a leak."""

    task_id: int | None
    route: str | None
    target_id: int | None
    x_m: float | None
    y_m: float | None
    utc: datetime
    ml: float


@dataclass(frozen=True, slots=True)
class Recent:
    """What a rolling minute still holds: ``ml`` was given ``age_s`` ago."""

    age_s: float
    ml: float


@dataclass(frozen=True, slots=True)
class Sums:
    """Millilitres, each an upper bound: booked, and the full pulse where no outcome is known.

    ``task_ml`` and ``target_ml`` of the task; ``day_ml`` of all tasks in the present UTC day; ``cell_ml`` by square
    metre of the task's row frame (``cell_of``), of the task and of every other task on the same route today;
    ``minute`` of all tasks, oldest first. Leaks count in task, day and minute; nobody knows where they fell.
    """

    task_ml: float
    day_ml: float
    target_ml: Mapping[int, float]
    cell_ml: Mapping[Cell, float]
    minute: tuple[Recent, ...]


def cell_of(x_m: float, y_m: float) -> Cell:
    """The square metre of the row frame that a place lies in."""
    return math.floor(x_m), math.floor(y_m)


def day_of(utc: datetime) -> datetime:
    """The beginning of the UTC day."""
    return utc.astimezone(UTC).replace(hour=0, minute=0, second=0, microsecond=0)


def add_up(given: Iterable[Given], task_id: int, route: str, now: datetime) -> Sums:
    """A row from the future (the clock was set back) counts as of this moment."""
    task_ml = day_ml = 0.0
    target_ml: dict[int, float] = {}
    cell_ml: dict[Cell, float] = {}
    recent: list[Recent] = []
    for item in given:
        today, ours = item.utc >= day_of(now), item.task_id == task_id
        day_ml += item.ml if today else 0.0
        task_ml += item.ml if ours else 0.0
        age = max(timedelta(0), now - item.utc)
        if age < MINUTE:
            recent.append(Recent(age.total_seconds(), item.ml))
        if item.target_id is None or item.x_m is None or item.y_m is None:
            continue
        if ours:
            target_ml[item.target_id] = target_ml.get(item.target_id, 0.0) + item.ml
        if ours or (today and item.route == route):
            cell = cell_of(item.x_m, item.y_m)
            cell_ml[cell] = cell_ml.get(cell, 0.0) + item.ml
    recent.sort(key=lambda entry: -entry.age_s)
    return Sums(task_ml, day_ml, target_ml, cell_ml, tuple(recent))

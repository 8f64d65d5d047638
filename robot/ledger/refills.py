"""What an operator said of the tank: an event that counts for a task, and everything booked since then.

"Since" goes by run and loop time: within a run that clock only rises, whatever the wall clock does.
"""

from __future__ import annotations

import json
from dataclasses import dataclass

REFILL = "refill"  # the kind of event

# Newest first.
REFILLS = "SELECT run_id, stamp_s, text FROM event WHERE kind = 'refill' ORDER BY id DESC"

# Shots by row and by hand, each without an outcome in full, and leaks.
BOOKED_SINCE = """
    SELECT
        (SELECT coalesce(sum(coalesce(booked_ml, full_ml)), 0.0)
         FROM intent LEFT JOIN result ON result.intent_id = intent.id WHERE (run_id, intent.stamp_s) >= (?1, ?2))
        + (SELECT coalesce(sum(booked_ml), 0.0) FROM leak WHERE (run_id, stamp_s) >= (?1, ?2))
"""


@dataclass(frozen=True, slots=True)
class Refill:
    """The tank held ``tank_ml`` at ``stamp_s`` in the loop time of a run."""

    task_id: int
    tank_ml: float
    cause: str
    run_id: int
    stamp_s: float


def refill_text(task_id: int, tank_ml: float, cause: str) -> str:
    """The event's text: JSON, whose numbers are read back to the last bit."""
    return json.dumps({"task": task_id, "tank_ml": tank_ml, "cause": cause}, allow_nan=False, ensure_ascii=False)


def refill_of(run_id: int, stamp_s: float, text: str) -> Refill:
    said = json.loads(text)
    return Refill(said["task"], said["tank_ml"], said["cause"], run_id, stamp_s)

"""Whether it is known what a target got. A target of which it is not known waits for an operator's release."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterable

from robot.ledger.records import ShotRow
from robot.ledger.values import Outcome
from robot.targets.values import TargetState

_UNCLEAR = """
    EXISTS (
        SELECT 1 FROM intent LEFT JOIN result ON result.intent_id = intent.id
        WHERE intent.task_id = ?1 AND intent.target_id = ?2
        AND (outcome IS NULL OR outcome IN ('shortened', 'uncertain'))
        AND intent.id > (
            SELECT coalesce(max(last_intent_id), 0) FROM release WHERE task_id = ?1 AND target_id = ?2
        )
    ) OR EXISTS (SELECT 1 FROM target WHERE task_id = ?1 AND id = ?2 AND state = 'uncertain')
"""
_LAST = """
    SELECT max(intent.id), coalesce(sum(outcome IS NULL), 0)
    FROM intent LEFT JOIN result ON result.intent_id = intent.id
    WHERE intent.task_id = ? AND intent.target_id = ?
"""


def unclear(db: sqlite3.Connection, task_id: int, target_id: int) -> bool:
    """It is marked so, or a shot at it since its last release was cut short, is uncertain, or has no outcome."""
    return bool(db.execute(f"SELECT {_UNCLEAR}", (task_id, target_id)).fetchone()[0])


def last_intent(db: sqlite3.Connection, task_id: int, target_id: int) -> tuple[int | None, int]:
    """(number of the newest intent for a target, how many of its intents have no outcome)."""
    last, unknown = db.execute(_LAST, (task_id, target_id)).fetchone()
    return last, unknown


def true_state(state: TargetState, reason: str, shots: Iterable[ShotRow]) -> tuple[TargetState, str]:
    """A target's state and reason as its shots since the last release make it: never open once the valve opened."""
    opened = [shot.result for shot in shots if shot.result is None or shot.result.outcome is not Outcome.NOT_OPENED]
    if not opened or state in (TargetState.SPRAYED, TargetState.UNCERTAIN):
        return state, reason
    if all(result is not None and result.outcome is Outcome.SPRAYED for result in opened):
        return TargetState.SPRAYED, "sprayed before the program was stopped"
    return TargetState.UNCERTAIN, "the valve opened for it before the program was stopped"

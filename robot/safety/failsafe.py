"""Fault -> action, as data; the most severe wins."""

from __future__ import annotations

from collections.abc import Iterable
from enum import IntEnum


class Action(IntEnum):
    """What a fault does, mildest first."""

    WARN = 0
    INHIBIT_SPRAY = 1
    PAUSE = 2
    SAFE_STOP = 3
    ESTOP = 4


# A supervised task that lost its device or fell silent.
FAILSAFE: dict[str, Action] = {
    "sensors": Action.SAFE_STOP,
    "odometry": Action.SAFE_STOP,
    "arm": Action.SAFE_STOP,
    "relay": Action.SAFE_STOP,
    "gps": Action.WARN,    # odometry and landmarks carry the pose on
    "modem": Action.WARN,  # nothing that moves needs it
}


def action_for(fault: str) -> Action:
    """The action of one fault; what the table does not know is taken for the worst that software can do."""
    return FAILSAFE.get(fault, Action.SAFE_STOP)


def most_severe(faults: Iterable[str]) -> Action:
    return max((action_for(fault) for fault in faults), default=Action.WARN)

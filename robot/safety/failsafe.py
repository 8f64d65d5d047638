"""Fault -> action, from the catalogue; the most severe wins."""

from __future__ import annotations

from collections.abc import Iterable

from robot.safety.catalogue import CATALOGUE, Action, Clear, FaultKind

_KINDS = {kind.id: kind for kind in CATALOGUE}
_UNKNOWN = "F34"

# Which fault it is when a supervised task, or a device of this name, fails or falls silent.
TASK_FAULTS: dict[str, str] = {
    "sensors": "F20b",
    "inputs": "F20b",
    "odometry": "F20",
    "wheels": "F20",
    "arm": "F11",
    "relay": "F01",
    "camera": "F50",
    "gps": "F60",
    "modem": "F70a",
}


def kind_of(fault_id: str) -> FaultKind:
    """The catalogue's row. ``KeyError`` with the known numbers for one that it does not have."""
    try:
        return _KINDS[fault_id]
    except KeyError:
        raise KeyError(f"no fault '{fault_id}' in the catalogue; it has {', '.join(_KINDS)}") from None


def fault_of(task: str) -> str:
    """The fault's number when this task or device fails; one that nobody foresaw is taken for a dead task."""
    return TASK_FAULTS.get(task, _UNKNOWN)


def most_severe(fault_ids: Iterable[str]) -> Action:
    """``WARN`` without a fault."""
    return max((kind_of(fault_id).action for fault_id in fault_ids), default=Action.WARN)


__all__ = ["TASK_FAULTS", "Action", "Clear", "fault_of", "kind_of", "most_severe"]

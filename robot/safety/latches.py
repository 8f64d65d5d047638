"""A latch outlives the program: a line that tells a mode, and the mode that the next life takes up from it."""

from __future__ import annotations

from robot.safety.modes import LATCHED
from robot.safety.values import Mode, SafetyState

BEFORE = "before the restart: "
TOLD_TO_END = ("stopped by SIG", "the program is going down")  # how the causes of an end that somebody asked for begin
_BETWEEN = "; "


def mode_line(state: SafetyState) -> str:
    """Mode and causes as one line."""
    return f"{state.mode} {_BETWEEN.join(state.causes)}".strip()


def taken_up(line: str) -> SafetyState:
    """What a new life comes up in after one whose last ``mode_line`` was this ("": there was none).

    Latched for the causes of before, or DISARMED when it was not latched, or only because it was told to end.
    """
    mode, _, text = line.partition(" ")
    if mode not in LATCHED:
        return SafetyState()
    causes = [cause for cause in text.split(_BETWEEN) if not cause.startswith(TOLD_TO_END)]
    if not causes:
        return SafetyState()
    return SafetyState(mode=Mode(mode), causes=tuple(dict.fromkeys(map(_from_before, causes))))


def concerns(state: SafetyState, fault_id: str) -> bool:
    """Whether this fault is active, or is a cause of the latch, one from before a restart too."""
    return any(fault.id == fault_id for fault in state.faults) or any(
        cause.endswith(f"[{fault_id}]") for cause in state.causes
    )


def _from_before(cause: str) -> str:
    cause = cause or "a cause that was not written down"
    return cause if cause.startswith(BEFORE) else f"{BEFORE}{cause}"

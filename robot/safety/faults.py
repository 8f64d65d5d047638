"""What a fault does to the machine's mode, and what may end it."""

from __future__ import annotations

from dataclasses import replace

from robot.safety.catalogue import Action, Clear
from robot.safety.failsafe import kind_of
from robot.safety.modes import latch, pause
from robot.safety.values import ActiveFault, Mode, SafetyState


def report_fault(state: SafetyState, fault_id: str, text: str, now_s: float) -> SafetyState:
    """Take a fault in: it is active from now on (unless it passes by itself), and its action is taken.

    The same fault again changes nothing while it is active. ``KeyError`` for one that is not in the catalogue.
    """
    kind = kind_of(fault_id)
    if any(fault.id == fault_id for fault in state.faults):
        return state
    if kind.clears is not Clear.PASSED:
        state = replace(state, faults=(*state.faults, ActiveFault(fault_id, text, now_s)))
    return _act(state, kind.action, f"{text} [{fault_id}]", kind.clears)


def clear_fault(state: SafetyState, fault_id: str) -> SafetyState:
    """The cause is gone. What needs an acknowledgement stays until then, unless the machine is disarmed anyway."""
    if kind_of(fault_id).clears is not Clear.GONE and state.mode is not Mode.DISARMED:
        return state
    faults = tuple(fault for fault in state.faults if fault.id != fault_id)
    return state if faults == state.faults else replace(state, faults=faults)


def _act(state: SafetyState, action: Action, cause: str, clears: Clear) -> SafetyState:
    if action is Action.ESTOP:
        return latch(state, Mode.ESTOP, cause)
    if action is Action.SAFE_STOP and state.mode is not Mode.DISARMED:
        return latch(state, state.mode if state.mode is Mode.ESTOP else Mode.SAFE_STOP, cause)
    if action is Action.PAUSE:
        return pause(state, cause, self_resume=clears is Clear.GONE)
    return state

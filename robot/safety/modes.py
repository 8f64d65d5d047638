"""Modes and what changes them. A reset never starts anything; STOP works in every mode."""

from __future__ import annotations

from dataclasses import replace
from enum import StrEnum

from robot.safety.arming import reasons_against_arming
from robot.safety.values import Decision, Inputs, Mode, SafetyState


class Verb(StrEnum):
    ARM = "arm"
    START = "start"
    OPERATE = "operate"
    PAUSE = "pause"
    RESUME = "resume"
    FINISH = "finish"
    STOP = "stop"
    ESTOP = "estop"
    ACKNOWLEDGE = "acknowledge"
    RESET = "reset"
    DISARM = "disarm"


# (mode, verb) -> mode. What is not here is refused, but STOP, ESTOP and DISARM, which every mode obeys.
MODE_CHANGES: dict[tuple[Mode, Verb], Mode] = {
    (Mode.DISARMED, Verb.ARM): Mode.READY,
    (Mode.READY, Verb.START): Mode.AUTO,
    (Mode.READY, Verb.OPERATE): Mode.MANUAL,
    (Mode.AUTO, Verb.PAUSE): Mode.PAUSED,
    (Mode.PAUSED, Verb.RESUME): Mode.AUTO,
    (Mode.AUTO, Verb.FINISH): Mode.READY,
    (Mode.MANUAL, Verb.FINISH): Mode.READY,
    (Mode.SAFE_STOP, Verb.ACKNOWLEDGE): Mode.DISARMED,
    (Mode.ESTOP, Verb.RESET): Mode.DISARMED,
}

_LATCHED = (Mode.SAFE_STOP, Mode.ESTOP)


def change_mode(
    state: SafetyState, verb: Verb, cause: str, inputs: Inputs | None, now_s: float
) -> tuple[SafetyState, Decision]:
    """The reducer of modes. A refused verb leaves the state as it was and says why."""
    if verb is Verb.ESTOP:
        return _latch(state, Mode.ESTOP, cause), Decision(())
    if verb is Verb.STOP:
        mode = state.mode if state.mode is Mode.ESTOP else Mode.SAFE_STOP
        return _latch(state, mode, cause), Decision(())
    if verb is Verb.DISARM and state.mode not in _LATCHED:
        return replace(state, mode=Mode.DISARMED, causes=()), Decision(())
    target = MODE_CHANGES.get((state.mode, verb))
    if target is None:
        return state, Decision((f"{verb} is not possible in mode {state.mode}",))
    reasons: tuple[str, ...] = ()
    if verb in (Verb.ARM, Verb.START, Verb.OPERATE, Verb.RESUME):
        reasons = reasons_against_arming(inputs, now_s)
    elif verb is Verb.RESET and (inputs is None or inputs.estop_pressed):
        reasons = ("the e-stop is still pressed (or unknown): release it first",)
    if reasons:
        return state, Decision(reasons)
    return replace(state, mode=target, causes=()), Decision(())


def _latch(state: SafetyState, mode: Mode, cause: str) -> SafetyState:
    return replace(state, mode=mode, causes=(*state.causes, cause) if cause not in state.causes else state.causes)

"""Modes and what changes them. A reset never starts anything; STOP works in every mode."""

from __future__ import annotations

from dataclasses import replace
from enum import StrEnum

from robot.safety.arming import reasons_against_arming, reasons_against_resuming
from robot.safety.catalogue import Clear
from robot.safety.failsafe import kind_of
from robot.safety.values import Decision, Inputs, Mode, SafetyState


class Verb(StrEnum):
    ARM = "arm"
    START = "start"
    OPERATE = "operate"
    PAUSE = "pause"
    RESUME = "resume"
    RESUME_SELF = "resume_self"  # the policy's, not a person's
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
    (Mode.PAUSED, Verb.PAUSE): Mode.PAUSED,
    (Mode.PAUSED, Verb.RESUME): Mode.AUTO,
    (Mode.PAUSED, Verb.RESUME_SELF): Mode.AUTO,
    (Mode.AUTO, Verb.FINISH): Mode.READY,
    (Mode.MANUAL, Verb.FINISH): Mode.READY,
    (Mode.SAFE_STOP, Verb.ACKNOWLEDGE): Mode.DISARMED,
    (Mode.DISARMED, Verb.ACKNOWLEDGE): Mode.DISARMED,
    (Mode.ESTOP, Verb.RESET): Mode.DISARMED,
}

LATCHED = (Mode.SAFE_STOP, Mode.ESTOP)
_TOWARDS_MOTION = (Verb.ARM, Verb.START, Verb.OPERATE)


def change_mode(
    state: SafetyState, verb: Verb, cause: str, inputs: Inputs | None, now_s: float
) -> tuple[SafetyState, Decision]:
    """The reducer of modes. A refused verb leaves the state as it was and says why."""
    if verb is Verb.ESTOP:
        return latch(state, Mode.ESTOP, cause), Decision(())
    if verb is Verb.STOP:
        return latch(state, state.mode if state.mode is Mode.ESTOP else Mode.SAFE_STOP, cause), Decision(())
    if verb is Verb.DISARM and state.mode not in LATCHED:
        return replace(state, mode=Mode.DISARMED, causes=()), Decision(())
    target = MODE_CHANGES.get((state.mode, verb))
    if target is None:
        return state, Decision((f"{verb} is not possible in mode {state.mode}",))
    if verb is Verb.PAUSE:
        return pause(state, cause, self_resume=False), Decision(())
    reasons = _reasons(state, verb, inputs, now_s)
    if reasons:
        return state, Decision(reasons)
    if verb in (Verb.ACKNOWLEDGE, Verb.RESET):
        state = replace(state, faults=tuple(f for f in state.faults if kind_of(f.id).clears is Clear.GONE))
    return replace(state, mode=target, causes=()), Decision(())


def _reasons(state: SafetyState, verb: Verb, inputs: Inputs | None, now_s: float) -> tuple[str, ...]:
    if verb in _TOWARDS_MOTION:
        return reasons_against_arming(state, inputs, now_s, first=verb is Verb.ARM)
    if verb in (Verb.RESUME, Verb.RESUME_SELF):
        return reasons_against_resuming(state, inputs, now_s, by_itself=verb is Verb.RESUME_SELF)
    if verb is Verb.RESET and (inputs is None or inputs.estop_pressed):
        return ("the e-stop is still pressed (or unknown): release it first",)
    return ()


def latch(state: SafetyState, mode: Mode, cause: str) -> SafetyState:
    """Into a mode that only an operator ends; a latched mode collects its causes, each once."""
    before = state.causes if state.mode in LATCHED else ()
    causes = before if cause in before else (*before, cause)
    return replace(state, mode=mode, causes=causes, self_resume=False)


def pause(state: SafetyState, cause: str, self_resume: bool) -> SafetyState:
    """Out of AUTO, not latched; any other mode stays. One cause that needs a person is enough to need one."""
    if state.mode is Mode.AUTO:
        return replace(state, mode=Mode.PAUSED, causes=(cause,), self_resume=self_resume)
    if state.mode is Mode.PAUSED:
        causes = state.causes if cause in state.causes else (*state.causes, cause)
        return replace(state, causes=causes, self_resume=state.self_resume and self_resume)
    return state

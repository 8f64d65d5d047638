"""The mission's state machine as data. The diagram in docs/mission.md is drawn from this table."""

from __future__ import annotations

from enum import StrEnum


class State(StrEnum):
    IDLE = "idle"
    MOVE = "move"      # drive to the next stop, arm stowed
    STOP = "stop"      # halt and settle (the operator's stop is a mode of safety, not this)
    DETECT = "detect"  # take a pair, find fruit, keep the book
    AIM = "aim"        # choose the next target and bring the nozzle there
    SPRAY = "spray"    # one dose
    DONE = "done"


class Event(StrEnum):
    STARTED = "started"
    ARRIVED = "arrived"
    SETTLED = "settled"
    TARGETS = "targets"
    NO_TARGETS = "no targets"
    AIMED = "aimed"
    SPRAYED = "sprayed"
    SKIPPED = "skipped"
    BASE_MOVED = "base moved"
    ROUTE_DONE = "route done"
    HALTED = "halted"


TRANSITIONS: dict[tuple[State, Event], State] = {
    (State.IDLE, Event.STARTED): State.MOVE,
    (State.MOVE, Event.ARRIVED): State.STOP,
    (State.MOVE, Event.ROUTE_DONE): State.DONE,
    (State.STOP, Event.SETTLED): State.DETECT,
    (State.DETECT, Event.TARGETS): State.AIM,
    (State.DETECT, Event.NO_TARGETS): State.MOVE,
    (State.DETECT, Event.BASE_MOVED): State.STOP,
    (State.AIM, Event.AIMED): State.SPRAY,
    (State.AIM, Event.NO_TARGETS): State.MOVE,
    (State.AIM, Event.BASE_MOVED): State.STOP,
    (State.SPRAY, Event.SPRAYED): State.AIM,
    (State.SPRAY, Event.SKIPPED): State.AIM,
    (State.MOVE, Event.HALTED): State.IDLE,
    (State.STOP, Event.HALTED): State.IDLE,
    (State.DETECT, Event.HALTED): State.IDLE,
    (State.AIM, Event.HALTED): State.IDLE,
    (State.SPRAY, Event.HALTED): State.IDLE,
}


class ImpossibleTransition(Exception):
    """A state reported an event that the table does not foresee: a defect, never ignored."""


def next_state(state: State, event: Event) -> State:
    """The state that follows; ``ImpossibleTransition`` when the table has no such row."""
    try:
        return TRANSITIONS[(state, event)]
    except KeyError:
        raise ImpossibleTransition(f"no transition from {state} on '{event}'") from None

from itertools import product
from pathlib import Path

import pytest

from robot.mission.diagram import mermaid
from robot.mission.machine import STATE_TASKS
from robot.mission.transitions import TRANSITIONS, Event, ImpossibleTransition, State, next_state

DOCS = Path(__file__).parents[3] / "docs" / "mission.md"


@pytest.mark.parametrize(("state", "event"), list(product(State, Event)))
def test_every_state_and_event_follow_the_table_or_are_a_named_defect(state, event):
    if (state, event) in TRANSITIONS:
        assert next_state(state, event) is TRANSITIONS[(state, event)]
    else:
        with pytest.raises(ImpossibleTransition, match=f"no transition from {state} on '{event}'"):
            next_state(state, event)


def test_every_working_state_has_a_task_and_can_be_halted():
    working = set(State) - {State.IDLE, State.DONE}
    assert set(STATE_TASKS) == working
    for state in working:
        assert next_state(state, Event.HALTED) is State.IDLE


def test_spray_is_entered_only_from_aim():
    assert {source for (source, _), target in TRANSITIONS.items() if target is State.SPRAY} == {State.AIM}


def test_every_state_is_reachable_from_idle():
    reached, frontier = {State.IDLE}, [State.IDLE]
    while frontier:
        here = frontier.pop()
        for (source, _), target in TRANSITIONS.items():
            if source is here and target not in reached:
                reached.add(target)
                frontier.append(target)
    assert reached == set(State)


def test_the_diagram_in_the_documents_is_the_table():
    assert mermaid() in DOCS.read_text()

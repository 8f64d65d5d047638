import itertools

import pytest

from robot.safety.failsafe import FAILSAFE, Action, action_for, most_severe


@pytest.mark.parametrize("fault", ["sensors", "odometry", "arm", "relay"])
def test_what_safety_needs_to_see_stops_the_machine_when_it_is_gone(fault):
    assert action_for(fault) is Action.SAFE_STOP


def test_a_fault_that_the_table_does_not_know_is_taken_for_a_grave_one():
    assert action_for("something new") is Action.SAFE_STOP


def test_the_most_severe_fault_wins_and_one_more_never_lowers_it():
    assert most_severe(()) is Action.WARN
    for count in range(1, len(FAILSAFE) + 1):
        for faults in itertools.combinations(FAILSAFE, count):
            assert most_severe(faults) == max(FAILSAFE[fault] for fault in faults)
            assert most_severe((*faults, "relay")) >= most_severe(faults)

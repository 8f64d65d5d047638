"""A latch outlives the program; an end that somebody asked for is none."""

import pytest

from robot.safety import LATCHED, ActiveFault, Mode, SafetyState, concerns, mode_line, taken_up

BUMPER = "the bumper was pressed [F59]"
BEFORE = "before the restart: "


@pytest.mark.parametrize("mode", LATCHED)
def test_a_latch_comes_back_with_its_causes_and_a_second_time_unchanged(mode):
    line = mode_line(SafetyState(mode=mode, causes=(BUMPER, "stopped by SIGTERM", "enough")))
    first = taken_up(line)
    assert first == SafetyState(mode=mode, causes=(f"{BEFORE}{BUMPER}", f"{BEFORE}enough"))
    assert taken_up(mode_line(first)) == first


@pytest.mark.parametrize(
    "line",
    [
        "", "disarmed", "auto", "ready", "paused the battery is low [F69]", "some_mode of a later program",
        "safe_stop stopped by SIGTERM", "safe_stop stopped by SIGINT", "safe_stop the program is going down",
        "safe_stop the program is going down; stopped by SIGTERM",
        "disarmed this command acknowledges the safe_stop before the restart: enough",
    ],
)  # fmt: skip
def test_what_was_not_latched_or_only_told_to_end_comes_up_disarmed(line):
    assert taken_up(line) == SafetyState()


def test_a_latch_without_a_word_is_a_latch_and_equal_causes_are_one():
    assert taken_up("safe_stop").causes == (f"{BEFORE}a cause that was not written down",)
    assert taken_up(f"estop {BEFORE}enough; enough").causes == (f"{BEFORE}enough",)


def test_a_fault_concerns_a_state_while_it_is_active_and_as_a_cause_of_its_latch():
    assert concerns(SafetyState(faults=(ActiveFault("F66", "check nozzle", 0.0),)), "F66")
    assert concerns(taken_up("safe_stop check nozzle [F66]"), "F66")
    assert not concerns(SafetyState(Mode.SAFE_STOP, (BUMPER,), faults=(ActiveFault("F59", BUMPER, 0.0),)), "F66")

from dataclasses import replace

import pytest

from robot.safety import MODE_CHANGES, Mode, SafetyState, Verb, change_mode, reasons_against_arming

from .test_envelope import GOOD, NOW_S


@pytest.mark.parametrize("mode", list(Mode))
@pytest.mark.parametrize("verb", list(Verb))
def test_every_verb_in_every_mode_does_what_the_table_says_or_is_refused(mode, verb):
    state, decision = change_mode(SafetyState(mode=mode), verb, "test", GOOD, NOW_S)
    if verb is Verb.ESTOP:
        assert state.mode is Mode.ESTOP
    elif verb is Verb.STOP:
        assert state.mode is (Mode.ESTOP if mode is Mode.ESTOP else Mode.SAFE_STOP)
    elif verb is Verb.DISARM and mode not in (Mode.ESTOP, Mode.SAFE_STOP):
        assert state.mode is Mode.DISARMED
    elif (mode, verb) == (Mode.PAUSED, Verb.RESUME_SELF):
        assert decision.reasons == ("this pause ends by an operator only",)
        assert state.mode is mode
    elif (mode, verb) in MODE_CHANGES:
        assert decision.allowed
        assert state.mode is MODE_CHANGES[(mode, verb)]
    else:
        assert decision.reasons == (f"{verb} is not possible in mode {mode}",)
        assert state.mode is mode


def test_no_way_leads_from_a_latched_mode_to_motion_in_one_step():
    for latched in (Mode.SAFE_STOP, Mode.ESTOP):
        for verb in Verb:
            state, _ = change_mode(SafetyState(mode=latched), verb, "test", GOOD, NOW_S)
            assert state.mode in (Mode.SAFE_STOP, Mode.ESTOP, Mode.DISARMED)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"estop_pressed": True}, "e-stop is pressed"),
        ({"bumper_pressed": True}, "bumper"),
        ({"valve_coil": True}, "valve's coil reads on"),
        ({"pump_coil": True}, "pump's coil reads on"),
        ({"sensors_s": NOW_S - 1.0}, "sensors reading"),
        ({"arm_healthy": False}, "arm"),
    ],
)
def test_arming_is_refused_with_a_readable_reason(change, words):
    state, decision = change_mode(SafetyState(), Verb.ARM, "test", replace(GOOD, **change), NOW_S)
    assert state.mode is Mode.DISARMED
    assert words in decision.reasons[0]


@pytest.mark.parametrize(
    ("mode", "verb"), [(Mode.READY, Verb.START), (Mode.READY, Verb.OPERATE), (Mode.PAUSED, Verb.RESUME)]
)
def test_what_forbids_arming_forbids_every_step_towards_motion(mode, verb):
    state, decision = change_mode(SafetyState(mode=mode), verb, "test", replace(GOOD, bumper_pressed=True), NOW_S)
    assert state.mode is mode
    assert decision.reasons == ("the bumper is pressed",)


def test_an_operator_takes_over_an_armed_machine_and_hands_it_back_armed():
    state, _ = change_mode(SafetyState(mode=Mode.READY), Verb.OPERATE, "test", GOOD, NOW_S)
    assert state.mode is Mode.MANUAL
    state, _ = change_mode(state, Verb.FINISH, "test", GOOD, NOW_S)
    assert state.mode is Mode.READY


def test_no_verb_leads_from_the_mission_to_the_operator_or_back_without_a_rest():
    for mode, other in ((Mode.AUTO, Mode.MANUAL), (Mode.PAUSED, Mode.MANUAL), (Mode.MANUAL, Mode.AUTO)):
        for verb in Verb:
            state, _ = change_mode(SafetyState(mode=mode), verb, "test", GOOD, NOW_S)
            assert state.mode is not other


def test_arming_needs_every_device():
    assert reasons_against_arming(SafetyState(), None, NOW_S, first=True) == ("not every device has reported yet",)


@pytest.mark.parametrize("inputs", [None, replace(GOOD, estop_pressed=True)])
def test_an_estop_cannot_be_reset_while_its_button_is_pressed_or_unknown(inputs):
    state, decision = change_mode(SafetyState(mode=Mode.ESTOP), Verb.RESET, "test", inputs, NOW_S)
    assert state.mode is Mode.ESTOP
    assert "release it first" in decision.reasons[0]


def test_a_latched_mode_keeps_each_of_its_causes_once():
    state = SafetyState(mode=Mode.AUTO)
    for cause in ("bumper", "operator", "bumper"):
        state, _ = change_mode(state, Verb.STOP, cause, GOOD, NOW_S)
    assert state.causes == ("bumper", "operator")
    state, _ = change_mode(state, Verb.ACKNOWLEDGE, "", GOOD, NOW_S)
    assert state == SafetyState(mode=Mode.DISARMED)

from dataclasses import replace

import pytest

from robot.safety import (
    CATALOGUE,
    Action,
    ActiveFault,
    Clear,
    Mode,
    SafetyState,
    Verb,
    change_mode,
    clear_fault,
    report_fault,
)

from .test_envelope import GOOD, NOW_S

ACTIVE = {kind.id: ActiveFault(kind.id, "what happened", NOW_S) for kind in CATALOGUE}
AFTER = {
    # what a fault of this action makes of each mode
    Action.WARN: {},
    Action.INHIBIT_SPRAY: {},
    Action.PAUSE: {Mode.AUTO: Mode.PAUSED},
    Action.SAFE_STOP: {mode: Mode.SAFE_STOP for mode in Mode if mode not in (Mode.DISARMED, Mode.ESTOP)},
    Action.ESTOP: dict.fromkeys(Mode, Mode.ESTOP),
}


@pytest.mark.parametrize("mode", list(Mode))
@pytest.mark.parametrize("kind", CATALOGUE, ids=lambda kind: kind.id)
def test_every_fault_does_in_every_mode_what_its_row_says(kind, mode):
    state = report_fault(SafetyState(mode=mode), kind.id, "what happened", NOW_S)
    assert state.mode is AFTER[kind.action].get(mode, mode)
    assert state.faults == (() if kind.clears is Clear.PASSED else (ACTIVE[kind.id],))
    if state.mode is not mode:
        assert state.causes == (f"what happened [{kind.id}]",)


def test_the_same_fault_again_changes_nothing():
    state = report_fault(SafetyState(mode=Mode.AUTO), "F60", "no fix", NOW_S)
    assert report_fault(state, "F60", "no fix either", NOW_S + 1.0) is state


def test_a_fault_that_the_catalogue_does_not_have_is_an_error():
    with pytest.raises(KeyError, match="F99"):
        report_fault(SafetyState(), "F99", "?", NOW_S)


@pytest.mark.parametrize("mode", list(Mode))
@pytest.mark.parametrize("kind", CATALOGUE, ids=lambda kind: kind.id)
def test_a_fault_is_cleared_by_its_cause_going_only_when_its_row_says_so_or_nothing_is_armed(kind, mode):
    state = SafetyState(mode=mode, faults=(ACTIVE[kind.id],))
    if kind.clears is Clear.GONE or mode is Mode.DISARMED:
        assert clear_fault(state, kind.id).faults == ()
    else:
        assert clear_fault(state, kind.id) is state
    assert clear_fault(state, kind.id).mode is mode


def test_clearing_one_fault_leaves_the_others():
    state = SafetyState(faults=(ACTIVE["F60"], ACTIVE["F69"]))
    assert clear_fault(state, "F60").faults == (ACTIVE["F69"],)
    assert clear_fault(state, "F61") is state


@pytest.mark.parametrize(
    ("mode", "verb"), [(Mode.SAFE_STOP, Verb.ACKNOWLEDGE), (Mode.DISARMED, Verb.ACKNOWLEDGE), (Mode.ESTOP, Verb.RESET)]
)
def test_an_acknowledgement_keeps_the_faults_that_end_by_themselves(mode, verb):
    state = SafetyState(mode=mode, causes=("x",), faults=tuple(ACTIVE.values()))
    state, decision = change_mode(state, verb, "", GOOD, NOW_S)
    assert decision.allowed
    assert state.mode is Mode.DISARMED
    assert state.causes == ()
    assert {fault.id for fault in state.faults} == {kind.id for kind in CATALOGUE if kind.clears is Clear.GONE}


@pytest.mark.parametrize(
    ("mode", "verb"),
    [(Mode.DISARMED, Verb.ARM), (Mode.READY, Verb.START), (Mode.READY, Verb.OPERATE), (Mode.PAUSED, Verb.RESUME)],
)
def test_a_standing_fault_that_forbids_motion_forbids_every_step_towards_it(mode, verb):
    for fault_id in ("F69", "F01"):
        state = SafetyState(mode=mode, faults=(ACTIVE[fault_id],))
        after, decision = change_mode(state, verb, "", GOOD, NOW_S)
        assert after is state
        assert decision.reasons == (f"what happened [{fault_id}]",)
    for fault_id in ("F60", "F56"):
        assert change_mode(SafetyState(mode=mode, faults=(ACTIVE[fault_id],)), verb, "", GOOD, NOW_S)[1].allowed


def test_without_readings_a_standing_fault_is_named_too():
    state = SafetyState(faults=(ACTIVE["F01"],))
    assert change_mode(state, Verb.ARM, "", None, NOW_S)[1].reasons == (
        "what happened [F01]", "not every device has reported yet",
    )  # fmt: skip


def test_a_pause_ends_by_itself_when_its_cause_is_gone_and_the_base_stands_where_it_stood():
    paused = report_fault(SafetyState(mode=Mode.AUTO), "F69", "battery", NOW_S)
    assert not change_mode(paused, Verb.RESUME_SELF, "", GOOD, NOW_S)[1].allowed
    well = clear_fault(paused, "F69")
    state, decision = change_mode(well, Verb.RESUME_SELF, "", replace(GOOD, moved_since_pause_m=0.2), NOW_S)
    assert decision.allowed
    assert state.mode is Mode.AUTO
    assert state.causes == ()
    for moved_m in (0.21, float("nan"), float("inf")):
        moved = replace(GOOD, moved_since_pause_m=moved_m)
        assert "while paused" in change_mode(well, Verb.RESUME_SELF, "", moved, NOW_S)[1].reasons[0]
        assert change_mode(well, Verb.RESUME, "", moved, NOW_S)[1].allowed
    assert change_mode(well, Verb.RESUME_SELF, "", None, NOW_S)[1].reasons == ("not every device has reported yet",)


def test_a_pause_that_an_operator_asked_for_never_ends_by_itself():
    by_hand, _ = change_mode(SafetyState(mode=Mode.AUTO), Verb.PAUSE, "lunch", GOOD, NOW_S)
    assert by_hand.causes == ("lunch",)
    assert not change_mode(by_hand, Verb.RESUME_SELF, "", GOOD, NOW_S)[1].allowed
    both = clear_fault(report_fault(by_hand, "F69", "battery", NOW_S), "F69")
    assert both.causes == ("lunch", "battery [F69]")
    assert not change_mode(both, Verb.RESUME_SELF, "", GOOD, NOW_S)[1].allowed
    other = report_fault(SafetyState(mode=Mode.AUTO), "F69", "battery", NOW_S)
    other, _ = change_mode(clear_fault(other, "F69"), Verb.PAUSE, "lunch", GOOD, NOW_S)
    assert not change_mode(other, Verb.RESUME_SELF, "", GOOD, NOW_S)[1].allowed
    again, _ = change_mode(by_hand, Verb.PAUSE, "lunch", GOOD, NOW_S)
    assert again.causes == ("lunch",)


def test_a_stop_ends_a_pause_for_good_and_forgets_its_causes():
    paused = report_fault(SafetyState(mode=Mode.AUTO), "F69", "battery", NOW_S)
    stopped = report_fault(paused, "F69b", "empty", NOW_S)
    assert stopped.mode is Mode.SAFE_STOP
    assert stopped.causes == ("empty [F69b]",)
    assert not stopped.self_resume


def test_an_estop_is_not_lowered_by_a_stop_and_a_stop_is_raised_by_an_estop():
    state = report_fault(SafetyState(mode=Mode.READY), "F70l", "pressed", NOW_S)
    state = report_fault(state, "F01", "relay", NOW_S)
    assert state.mode is Mode.ESTOP
    assert state.causes == ("pressed [F70l]", "relay [F01]")
    other = report_fault(report_fault(SafetyState(mode=Mode.READY), "F01", "relay", NOW_S), "F70l", "pressed", NOW_S)
    assert other.mode is Mode.ESTOP
    assert other.causes == ("relay [F01]", "pressed [F70l]")

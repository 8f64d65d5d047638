"""The last millimetre of each limit, all reasons at once, and the words that a person reads."""

import math
from dataclasses import replace

import pytest

from robot.safety import (
    ActiveFault,
    Booking,
    Decision,
    Given,
    Lease,
    Mode,
    MotionRequest,
    SafetyState,
    Verb,
    authorise_motion,
    authorise_spray,
    beat_lease,
    change_mode,
    report_fault,
    settle_booking,
    still_allowed,
    take_lease,
    watch,
)

from .test_envelope import ARM, AUTO, FORWARD, GOOD, LIMITS, NOW_S, SHOT
from .test_monitor import WATCHED

ALL_WRONG = replace(
    GOOD, sensors_s=0.0, estop_pressed=True, bumper_pressed=True, tilt_rad=0.3, pressure_bar=1.0, base_speed_m_s=0.02,
    moved_since_frame_m=0.02, arm_settled=False, arm_stowed=False, arm_healthy=False, valve_coil=True, pump_coil=True,
    tank_left_ml=1.0, fence_margin_m=-0.25, moved_since_pause_m=0.5,
)  # fmt: skip
FAULT = ActiveFault("F69", "battery", NOW_S)
MACHINE = (
    "sensors reading is 100.00 s old (limit 0.5 s)",
    "the e-stop is pressed",
    "the bumper is pressed",
    "the arm reports a fault or its torque is off",
    "the rover tilts 0.30 rad (limit 0.26)",
)


def test_a_shot_is_refused_with_every_reason_in_the_order_of_the_house():
    state = SafetyState(mode=Mode.MANUAL, faults=(FAULT,))
    request = replace(SHOT, dose_ml=16.0)
    assert authorise_spray(state, ALL_WRONG, request, LIMITS, NOW_S)[1].reasons == (
        "nobody holds the controls; take them first",
        "battery [F69]",
        *MACHINE,
        "the base is moving",
        "the arm has not settled",
        "the base moved 20 mm since the target was seen",
        "pressure is 1.00 bar (needs 2.40)",
        "the tank holds 1 ml (reserve 200)",
        "the valve's coil reads on",
        "shot: 16.00 ml is over the cap of 15.00",
    )


def test_a_motion_of_the_base_is_refused_with_every_reason():
    state = SafetyState(mode=Mode.PAUSED, causes=("battery [F69]",), faults=(FAULT,))
    request = MotionRequest("base", 0.9, math.nan)
    assert authorise_motion(state, ALL_WRONG, request, LIMITS, NOW_S).reasons == (
        "mode is paused",
        "battery [F69]",
        "battery [F69]",
        *MACHINE,
        "the valve is open or a shot is under way",
        "the arm is not stowed",
        "base speed 0.9 m/s is over the limit of 0.3",
        "the rover is 0.25 m outside of the geofence: drive it back by hand, at 0.1 m/s at most",
        "yaw rate nan is not a number",
    )


def test_a_motion_of_the_arm_and_of_nothing_is_refused_with_every_reason():
    spraying = replace(GOOD, valve_coil=True, base_speed_m_s=0.02)
    shut = "the valve is open or a shot is under way"
    assert authorise_motion(AUTO, spraying, ARM, LIMITS, NOW_S).reasons == (shut, "the base is moving")
    assert authorise_motion(AUTO, spraying, MotionRequest("tail"), LIMITS, NOW_S).reasons == (
        shut, "unknown part 'tail'",
    )  # fmt: skip


def test_the_last_look_gives_every_reason():
    wrong = replace(GOOD, bumper_pressed=True, base_speed_m_s=0.02, arm_settled=False)
    assert still_allowed(AUTO, wrong, NOW_S).reasons == (
        "the bumper is pressed", "the base is moving", "the arm has not settled",
    )  # fmt: skip


def test_a_step_towards_motion_is_refused_with_every_reason():
    state = SafetyState(faults=(FAULT,))
    coils = ("the valve's coil reads on", "the pump's coil reads on")
    assert change_mode(state, Verb.ARM, "", ALL_WRONG, NOW_S)[1].reasons == ("battery [F69]", *MACHINE, *coils)
    ready = replace(state, mode=Mode.READY)
    assert change_mode(ready, Verb.START, "", ALL_WRONG, NOW_S)[1].reasons == ("battery [F69]", *MACHINE, coils[0])
    paused = replace(state, mode=Mode.PAUSED)
    assert change_mode(paused, Verb.RESUME_SELF, "", ALL_WRONG, NOW_S)[1].reasons == (
        "battery [F69]",
        *MACHINE,
        coils[0],
        "this pause ends by an operator only",
        "the base moved 0.50 m while paused (limit 0.2 m)",
    )
    pump = replace(GOOD, pump_coil=True)
    assert change_mode(SafetyState(mode=Mode.PAUSED), Verb.RESUME, "", pump, NOW_S)[1].allowed
    assert change_mode(SafetyState(mode=Mode.READY), Verb.START, "", pump, NOW_S)[1].allowed


def test_a_reset_with_the_button_pressed_says_what_to_do():
    pressed = replace(GOOD, estop_pressed=True)
    assert change_mode(SafetyState(mode=Mode.ESTOP), Verb.RESET, "", pressed, NOW_S)[1].reasons == (
        "the e-stop is still pressed (or unknown): release it first",
    )


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"valve_coil": True}, "the valve's coil reads on though nobody opened it"),
        ({"bumper_pressed": True}, "the bumper was pressed"),
        ({"fence_margin_m": -0.25}, "the rover is 0.25 m outside of the geofence"),
        ({"tilt_rad": 0.5}, "the rover tilts 0.50 rad (stops at 0.44)"),
        ({"tank_left_ml": 205.4}, "the tank holds 205 ml (reserve 200): refill it"),
        ({"battery_v": 22.04}, "the battery is at 22.0 V (low below 22.8): charge it"),
        ({"estop_pressed": True}, "the e-stop was pressed"),
        ({"arm_torque_on": False}, "the arm has lost its torque: a servo started anew"),
    ],
)
def test_a_fault_of_the_readings_tells_a_person_what_is_wrong_and_since_when(change, text):
    (fault,) = watch(SafetyState(mode=Mode.AUTO), replace(GOOD, **change), WATCHED, NOW_S).faults
    assert fault.text == text
    assert fault.since_s == NOW_S


def test_a_lost_heartbeat_says_whose_and_for_how_long():
    (nobody,) = watch(SafetyState(mode=Mode.MANUAL), GOOD, WATCHED, NOW_S).faults
    assert nobody.text == "nobody holds the controls; take them first"
    (silent,) = watch(SafetyState(mode=Mode.MANUAL, lease=Lease("tablet", 0.0, 99.0)), GOOD, WATCHED, NOW_S).faults
    assert silent.text == "'tablet' has given no sign of life for 1.00 s (limit 0.5 s)"


def test_an_empty_battery_is_told_with_its_own_limit():
    faults = watch(SafetyState(mode=Mode.AUTO), replace(GOOD, battery_v=21.0), WATCHED, NOW_S).faults
    assert faults[1].text == "the battery is at 21.0 V (empty below 21.6): charge it"


# --- each limit itself is allowed ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "change",
    [
        {"tilt_rad": 0.26}, {"moved_since_frame_m": 0.005}, {"pressure_bar": 2.4}, {"tank_left_ml": 205.5},
        {"base_speed_m_s": 0.01}, {"base_speed_m_s": -0.01},
    ],
)  # fmt: skip
def test_a_shot_at_a_limit_is_allowed(change):
    assert authorise_spray(AUTO, replace(GOOD, **change), SHOT, LIMITS, NOW_S)[1] == Decision(())


def test_a_motion_at_a_limit_is_allowed():
    fastest = MotionRequest("base", 0.3, 0.0)
    for margin_m in (0.0, 0.5):
        assert authorise_motion(AUTO, replace(GOOD, fence_margin_m=margin_m), fastest, LIMITS, NOW_S) == Decision(())
    assert authorise_motion(AUTO, replace(GOOD, base_speed_m_s=0.01), ARM, LIMITS, NOW_S) == Decision(())
    assert authorise_motion(SafetyState(), None, MotionRequest("base"), LIMITS, NOW_S) == Decision(())


@pytest.mark.parametrize(("name", "limit_s"), [("sensors", 0.5), ("odometry", 0.3), ("arm", 0.3), ("relay", 1.0)])
def test_a_reading_at_its_age_is_fresh_and_one_from_the_future_is_not(name, limit_s):
    stamps = {f"{other}_s": 0.0 for other in ("sensors", "odometry", "arm", "relay")}
    fresh = replace(GOOD, **stamps)
    at_limit = replace(fresh, **{f"{other}_s": limit_s for other in ("sensors", "odometry", "arm", "relay")})
    at_limit = replace(at_limit, **{f"{name}_s": 0.0})
    assert authorise_motion(AUTO, at_limit, FORWARD, LIMITS, limit_s).allowed
    assert not authorise_motion(AUTO, at_limit, FORWARD, LIMITS, math.nextafter(limit_s, 9.0)).allowed
    for ahead_s, allowed in ((1e-6, True), (1.1e-6, False), (0.5, False)):
        early = replace(fresh, **{f"{name}_s": ahead_s})
        assert authorise_motion(AUTO, early, FORWARD, LIMITS, 0.0).allowed == allowed


def test_a_heartbeat_at_its_age_counts_and_one_from_the_future_does_not():
    for beat_s, now_s, allowed in ((0.0, 0.5, True), (1e-6, 0.0, True), (1.1e-6, 0.0, False)):
        state = SafetyState(mode=Mode.MANUAL, lease=Lease("tablet", 0.0, beat_s))
        inputs = replace(GOOD, sensors_s=now_s, odometry_s=now_s, arm_s=now_s, relay_s=now_s)
        assert authorise_motion(state, inputs, ARM, LIMITS, now_s).allowed == allowed


def test_the_faults_of_the_readings_begin_beyond_their_limits():
    at_limit = replace(GOOD, tilt_rad=math.radians(25.0), battery_v=21.6)
    state = watch(SafetyState(mode=Mode.AUTO), at_limit, replace(WATCHED, battery_low_v=21.6), NOW_S)
    assert state == SafetyState(mode=Mode.AUTO)


def test_a_shot_of_a_minute_ago_counts_no_more():
    earlier = replace(AUTO, bookings=(Booking(1, NOW_S - 60.0, 3, 59.0, False),))
    assert authorise_spray(earlier, GOOD, SHOT, LIMITS, NOW_S)[1].allowed
    later = replace(AUTO, bookings=(Booking(1, NOW_S - 59.99, 3, 59.0, False),))
    assert authorise_spray(later, GOOD, SHOT, LIMITS, NOW_S)[1].reasons == (
        "rolling minute: 64.50 ml is over the cap of 60.00",
    )


def test_what_earlier_runs_gave_in_the_last_minute_counts():
    for age_s, allowed in ((59.9, False), (60.0, True)):
        state = replace(AUTO, given=Given(recent=((NOW_S - age_s, 55.0),)))
        assert authorise_spray(state, GOOD, SHOT, LIMITS, NOW_S)[1].allowed == allowed
    early = replace(GOOD, sensors_s=5.0, odometry_s=5.0, arm_s=5.0, relay_s=5.0)
    before_the_clock_began = replace(AUTO, given=Given(recent=((-50.0, 55.0),)))
    _, decision = authorise_spray(before_the_clock_began, early, SHOT, LIMITS, 5.0)
    assert decision.reasons == ("rolling minute: 60.50 ml is over the cap of 60.00",)
    late = replace(GOOD, sensors_s=11.0, odometry_s=11.0, arm_s=11.0, relay_s=11.0)
    assert authorise_spray(before_the_clock_began, late, SHOT, LIMITS, 11.0)[1].allowed


def test_how_far_the_base_moved_is_told_in_millimetres():
    _, decision = authorise_spray(AUTO, replace(GOOD, moved_since_frame_m=2.0), SHOT, LIMITS, NOW_S)
    assert decision.reasons == ("the base moved 2000 mm since the target was seen",)


def test_what_this_run_gave_counts_for_the_task():
    state = replace(AUTO, given=Given(task_ml=990.0), bookings=(Booking(1, 0.0, 3, 5.0, False),))
    _, decision = authorise_spray(state, GOOD, SHOT, LIMITS, NOW_S)
    assert decision.reasons == ("task: 1000.50 ml is over the cap of 1000.00",)


def test_a_shot_at_nothing_has_no_square_metre():
    assert authorise_spray(AUTO, GOOD, SHOT, replace(LIMITS, max_cell_ml=0.5), NOW_S)[1].allowed


def test_a_cap_forgives_a_rounding_and_no_more():
    rounding = replace(SHOT, pulse_s=2.0 + 1e-9)
    assert authorise_spray(AUTO, GOOD, rounding, LIMITS, NOW_S)[1].allowed
    assert not authorise_spray(AUTO, GOOD, replace(SHOT, pulse_s=2.0 + 2e-9), LIMITS, NOW_S)[1].allowed


# --- what a step leaves behind ------------------------------------------------------------------------------------


def test_only_the_pending_booking_of_this_target_is_settled():
    bookings = (Booking(1, 1.0, 7, 2.0, False), Booking(2, 2.0, 8, 3.0, True))
    assert settle_booking(replace(AUTO, bookings=bookings), 7, 0.5, NOW_S).bookings == bookings
    settled = settle_booking(replace(AUTO, bookings=bookings), 8, 0.5, NOW_S)
    assert settled.bookings == (bookings[0], Booking(2, NOW_S, 8, 0.5, False))


@pytest.mark.parametrize(
    ("state", "verb", "after"),
    [
        (SafetyState(mode=Mode.AUTO), Verb.ESTOP, SafetyState(mode=Mode.ESTOP, causes=("why",))),
        (SafetyState(mode=Mode.AUTO), Verb.STOP, SafetyState(mode=Mode.SAFE_STOP, causes=("why",))),
        (SafetyState(mode=Mode.AUTO), Verb.PAUSE, SafetyState(mode=Mode.PAUSED, causes=("why",))),
        (SafetyState(mode=Mode.PAUSED, causes=("x",)), Verb.DISARM, SafetyState()),
        (SafetyState(mode=Mode.PAUSED, causes=("x",)), Verb.RESUME, SafetyState(mode=Mode.AUTO)),
        (SafetyState(), Verb.ARM, SafetyState(mode=Mode.READY)),
    ],
)
def test_a_verb_leaves_exactly_this(state, verb, after):
    new, decision = change_mode(state, verb, "why", GOOD, NOW_S)
    assert new == after
    assert new.self_resume is False
    assert decision == Decision(())


def test_two_faults_that_end_by_themselves_leave_a_pause_that_does():
    state = report_fault(report_fault(SafetyState(mode=Mode.AUTO), "F69", "low", NOW_S), "F65", "empty", NOW_S)
    assert state.self_resume is True
    assert state.causes == ("low [F69]", "empty [F65]")


def test_a_lease_is_taken_and_kept_without_a_reason_against_it():
    state, decision = take_lease(SafetyState(), "tablet", 1.0)
    assert decision == Decision(())
    assert beat_lease(state, "tablet", 2.0)[1] == Decision(())

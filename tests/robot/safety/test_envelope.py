from dataclasses import replace

import pytest

from robot.safety import (
    ActiveFault,
    Booking,
    Given,
    Inputs,
    Lease,
    Limits,
    Mode,
    MotionRequest,
    SafetyState,
    SprayRequest,
    authorise_motion,
    authorise_spray,
    settle_booking,
    still_allowed,
)

NOW_S = 100.0
GOOD = Inputs(
    sensors_s=NOW_S, estop_pressed=False, bumper_pressed=False, tilt_rad=0.02, pressure_bar=2.7, odometry_s=NOW_S,
    base_speed_m_s=0.0, moved_since_frame_m=0.0, base_commanded=False, arm_s=NOW_S, arm_settled=True, arm_stowed=True,
    arm_healthy=True, relay_s=NOW_S, valve_coil=False, tank_left_ml=5000.0,
)
LIMITS = Limits(
    max_shot_ml=15.0, max_target_ml=20.0, max_cell_ml=50.0, max_minute_ml=60.0,
    max_task_ml=1000.0, max_day_ml=2000.0, max_pulse_s=2.0,
    max_base_speed_m_s=0.3, tank_reserve_ml=200.0, min_pressure_bar=2.4,
)
AUTO = SafetyState(mode=Mode.AUTO)
SHOT = SprayRequest(target_id=7, dose_ml=4.0, full_ml=5.5, open_s=0.32, pulse_s=0.4)
FORWARD = MotionRequest("base", 0.2, 0.0)
ARM = MotionRequest("arm")


def test_a_shot_inside_every_limit_is_allowed_and_booked_as_pending_with_its_full_pulse():
    state, decision = authorise_spray(AUTO, GOOD, SHOT, LIMITS, NOW_S)
    assert decision.allowed
    assert state.bookings == (Booking(1, NOW_S, 7, 5.5, pending=True),)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"sensors_s": NOW_S - 0.6}, "sensors reading is 0.60 s old"),
        ({"odometry_s": NOW_S - 0.4}, "odometry reading"),
        ({"arm_s": NOW_S - 0.4}, "arm reading"),
        ({"relay_s": NOW_S - 1.1}, "relay reading"),
        ({"relay_s": NOW_S + 5.0}, "relay reading"),
        ({"estop_pressed": True}, "e-stop is pressed"),
        ({"bumper_pressed": True}, "bumper is pressed"),
        ({"tilt_rad": 0.3}, "tilts"),
        ({"tilt_rad": float("nan")}, "tilts"),
        ({"arm_healthy": False}, "arm reports a fault"),
        ({"arm_settled": False}, "arm has not settled"),
        ({"base_speed_m_s": 0.05}, "base is moving"),
        ({"base_speed_m_s": -0.05}, "base is moving"),
        ({"base_commanded": True}, "base is moving"),
        ({"moved_since_frame_m": 0.006}, "moved 6 mm"),
        ({"moved_since_frame_m": float("nan")}, "moved"),
        ({"pressure_bar": 2.0}, "pressure is 2.00 bar"),
        ({"pressure_bar": float("nan")}, "pressure"),
        ({"tank_left_ml": 203.0}, "tank holds 203 ml"),
        ({"tank_left_ml": float("nan")}, "tank"),
        ({"valve_coil": True}, "coil reads on"),
    ],
)
def test_a_shot_is_refused_with_the_reason_when_one_input_is_not_as_it_must_be(change, words):
    state, decision = authorise_spray(AUTO, replace(GOOD, **change), SHOT, LIMITS, NOW_S)
    assert state is AUTO
    assert len(decision.reasons) == 1
    assert words in decision.reasons[0]


@pytest.mark.parametrize("mode", [mode for mode in Mode if mode not in (Mode.AUTO, Mode.MANUAL)])
def test_nothing_sprays_and_nothing_moves_outside_auto_and_manual(mode):
    state = SafetyState(mode=mode, causes=("because",))
    assert authorise_spray(state, GOOD, SHOT, LIMITS, NOW_S)[1].reasons == (f"mode is {mode}", "because")
    assert not authorise_motion(state, GOOD, FORWARD, LIMITS, NOW_S).allowed
    assert not authorise_motion(state, GOOD, ARM, LIMITS, NOW_S).allowed
    assert not still_allowed(state, GOOD, NOW_S).allowed


def test_without_readings_everything_is_refused():
    words = "not every device has reported yet"
    assert words in authorise_spray(AUTO, None, SHOT, LIMITS, NOW_S)[1].reasons
    assert words in authorise_motion(AUTO, None, FORWARD, LIMITS, NOW_S).reasons
    assert words in still_allowed(AUTO, None, NOW_S).reasons


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"pulse_s": 2.1}, "pulse: 2.10 s is over the cap of 2.00"),
        ({"open_s": 0.5}, "opening: 0.50 s is over the cap of 0.40"),
        ({"dose_ml": 16.0}, "shot: 16.00 ml"),
        ({"full_ml": 21.0}, "target: 21.00 ml"),
        ({"dose_ml": float("nan")}, "not made of positive numbers"),
        ({"full_ml": 0.0}, "not made of positive numbers"),
        ({"open_s": -0.1}, "not made of positive numbers"),
        ({"pulse_s": float("inf")}, "not made of positive numbers"),
    ],
)
def test_a_shot_over_a_cap_is_refused(change, words):
    reasons = authorise_spray(AUTO, GOOD, replace(SHOT, **change), LIMITS, NOW_S)[1].reasons
    assert len(reasons) == 1
    assert words in reasons[0]


def test_the_cap_of_a_target_counts_earlier_runs_and_earlier_shots():
    earlier = replace(AUTO, given=Given(target_ml=((7, 10.0),)), bookings=(Booking(1, NOW_S - 90.0, 7, 5.0, False),))
    assert "target: 20.50 ml" in authorise_spray(earlier, GOOD, SHOT, LIMITS, NOW_S)[1].reasons[0]
    other = replace(SHOT, target_id=8)
    assert authorise_spray(earlier, GOOD, other, LIMITS, NOW_S)[1].allowed


def test_the_cap_of_a_minute_rolls():
    many = tuple(Booking(n, NOW_S - 50.0, n, 14.0, False) for n in range(20, 24))
    state = replace(AUTO, bookings=many)
    assert "rolling minute: 61.50 ml" in authorise_spray(state, GOOD, SHOT, LIMITS, NOW_S)[1].reasons[0]
    later = replace(GOOD, sensors_s=111.0, odometry_s=111.0, arm_s=111.0, relay_s=111.0)
    assert authorise_spray(state, later, SHOT, LIMITS, 111.0)[1].allowed


def test_the_cap_of_the_task_counts_earlier_runs():
    state = replace(AUTO, given=Given(task_ml=995.0))
    assert "task: 1000.50 ml" in authorise_spray(state, GOOD, SHOT, LIMITS, NOW_S)[1].reasons[0]


def test_the_cap_of_the_day_counts_earlier_tasks_and_this_run():
    state = replace(AUTO, given=Given(day_ml=1990.0), bookings=(Booking(1, NOW_S - 90.0, 3, 5.0, False),))
    assert "day: 2000.50 ml" in authorise_spray(state, GOOD, SHOT, LIMITS, NOW_S)[1].reasons[0]


def test_the_cap_of_a_square_metre_counts_all_its_targets_and_what_is_pending():
    here, there = (2, 0), (3, 0)
    state = replace(
        AUTO,
        given=Given(cell_ml=((here, 30.0), (there, 49.0))),
        bookings=(Booking(1, NOW_S - 90.0, 3, 15.0, False, here), Booking(2, NOW_S - 90.0, 4, 9.0, False, there)),
    )
    _, decision = authorise_spray(state, GOOD, replace(SHOT, cell=here), LIMITS, NOW_S)
    assert "square metre: 50.50 ml" in decision.reasons[0]
    assert authorise_spray(state, GOOD, replace(SHOT, cell=(4, 0)), LIMITS, NOW_S)[1].allowed
    booked, _ = authorise_spray(AUTO, GOOD, replace(SHOT, cell=here), LIMITS, NOW_S)
    assert booked.bookings[0].cell == here


def test_a_cap_is_reached_and_not_exceeded():
    for cap in ("max_target_ml", "max_cell_ml", "max_minute_ml", "max_task_ml", "max_day_ml"):
        exact = replace(LIMITS, **{cap: 5.5})
        assert authorise_spray(AUTO, GOOD, replace(SHOT, cell=(0, 0)), exact, NOW_S)[1].allowed
        below = replace(LIMITS, **{cap: 5.499})
        assert len(authorise_spray(AUTO, GOOD, replace(SHOT, cell=(0, 0)), below, NOW_S)[1].reasons) == 1


@pytest.mark.parametrize("fault_id", ["F22", "F65", "F10"])
def test_a_fault_that_forbids_spray_forbids_the_shot_and_its_last_look(fault_id):
    state = replace(AUTO, faults=(ActiveFault(fault_id, "something", NOW_S),))
    assert authorise_spray(state, GOOD, SHOT, LIMITS, NOW_S)[1].reasons == (f"something [{fault_id}]",)
    assert still_allowed(state, GOOD, NOW_S).reasons == (f"something [{fault_id}]",)


def test_a_fault_forbids_motion_only_when_the_table_says_so():
    inhibits = replace(AUTO, faults=(ActiveFault("F56", "the base moved", NOW_S), ActiveFault("F60", "no fix", NOW_S)))
    assert authorise_motion(inhibits, GOOD, FORWARD, LIMITS, NOW_S).allowed
    pauses = replace(AUTO, faults=(ActiveFault("F69", "battery", NOW_S),))
    assert authorise_motion(pauses, GOOD, ARM, LIMITS, NOW_S).reasons == ("battery [F69]",)


def test_by_hand_nothing_moves_without_a_living_holder_of_the_lease():
    for lease, words in (
        (None, "nobody holds the controls"),
        (Lease("tablet", NOW_S - 9.0, NOW_S - 0.6), "no sign of life for 0.60 s"),
        (Lease("tablet", NOW_S, NOW_S + 1.0), "no sign of life"),
    ):
        by_hand = SafetyState(mode=Mode.MANUAL, lease=lease)
        assert words in authorise_motion(by_hand, GOOD, ARM, LIMITS, NOW_S).reasons[0]
        assert words in authorise_spray(by_hand, GOOD, SHOT, LIMITS, NOW_S)[1].reasons[0]
    by_hand = SafetyState(mode=Mode.MANUAL, lease=Lease("tablet", NOW_S - 9.0, NOW_S - 0.4))
    assert authorise_motion(by_hand, GOOD, ARM, LIMITS, NOW_S).allowed
    assert authorise_spray(by_hand, GOOD, SHOT, LIMITS, NOW_S)[1].allowed


def test_outside_of_the_geofence_the_base_is_driven_back_by_hand_and_slowly():
    outside = replace(GOOD, fence_margin_m=-0.3)
    slow, fast = MotionRequest("base", -0.1, 0.0), MotionRequest("base", -0.11, 0.0)
    by_hand = SafetyState(mode=Mode.MANUAL, lease=Lease("tablet", NOW_S, NOW_S))
    assert authorise_motion(by_hand, outside, slow, LIMITS, NOW_S).allowed
    assert "0.30 m outside" in authorise_motion(by_hand, outside, fast, LIMITS, NOW_S).reasons[0]
    assert "0.30 m outside" in authorise_motion(AUTO, outside, slow, LIMITS, NOW_S).reasons[0]
    assert authorise_motion(by_hand, outside, ARM, LIMITS, NOW_S).allowed
    unknown = replace(GOOD, fence_margin_m=float("nan"))
    assert "geofence" in authorise_motion(AUTO, unknown, FORWARD, LIMITS, NOW_S).reasons[0]


def test_one_shot_at_a_time():
    state, _ = authorise_spray(AUTO, GOOD, SHOT, LIMITS, NOW_S)
    assert "a shot is under way" in authorise_spray(state, GOOD, replace(SHOT, target_id=8), LIMITS, NOW_S)[1].reasons
    assert not authorise_motion(state, GOOD, ARM, LIMITS, NOW_S).allowed


def test_what_was_booked_replaces_the_pending_upper_bound_and_nothing_else():
    state, _ = authorise_spray(replace(AUTO, bookings=(Booking(1, 1.0, 3, 2.0, False),)), GOOD, SHOT, LIMITS, NOW_S)
    settled = settle_booking(state, 7, 4.2, NOW_S + 1.0)
    assert settled.bookings == (Booking(1, 1.0, 3, 2.0, False), Booking(2, NOW_S + 1.0, 7, 4.2, False))


def test_the_base_may_drive_with_the_arm_stowed_and_a_stop_is_always_allowed():
    assert authorise_motion(AUTO, GOOD, FORWARD, LIMITS, NOW_S).allowed
    assert authorise_motion(SafetyState(), None, MotionRequest("base"), LIMITS, NOW_S).allowed
    assert "not stowed" in authorise_motion(AUTO, replace(GOOD, arm_stowed=False), FORWARD, LIMITS, NOW_S).reasons[0]


@pytest.mark.parametrize(
    ("request_", "words"),
    [
        (MotionRequest("base", 0.31, 0.0), "over the limit"),
        (MotionRequest("base", float("nan"), 0.0), "over the limit"),
        (MotionRequest("base", 0.1, float("nan")), "not a number"),
        (MotionRequest("tail", 0.1, 0.0), "unknown part 'tail'"),
    ],
)
def test_a_senseless_motion_is_refused(request_, words):
    assert words in authorise_motion(AUTO, GOOD, request_, LIMITS, NOW_S).reasons[0]


def test_nothing_moves_while_the_valve_is_open():
    spraying = replace(GOOD, valve_coil=True)
    for request in (FORWARD, ARM):
        assert "valve is open" in authorise_motion(AUTO, spraying, request, LIMITS, NOW_S).reasons[0]


def test_the_arm_does_not_move_while_the_base_does():
    assert "base is moving" in authorise_motion(AUTO, replace(GOOD, base_speed_m_s=0.1), ARM, LIMITS, NOW_S).reasons[0]


def test_the_last_look_sees_an_arm_that_was_pushed():
    assert still_allowed(AUTO, GOOD, NOW_S).allowed
    assert "arm has not settled" in still_allowed(AUTO, replace(GOOD, arm_settled=False), NOW_S).reasons[0]


@pytest.mark.parametrize("value", [51.0, -1.0, float("nan"), float("inf")])
def test_no_configuration_can_widen_the_hard_envelope(value):
    with pytest.raises(ValueError, match=r"max_shot_ml must be between 0 and 50\.0 \(hard envelope\)"):
        replace(LIMITS, max_shot_ml=value)


def test_the_envelope_bounds_every_limit_and_its_bound_itself_is_allowed():
    bounds = {
        "max_shot_ml": 50.0, "max_target_ml": 100.0, "max_cell_ml": 2000.0, "max_minute_ml": 1000.0,
        "max_task_ml": 500_000.0, "max_day_ml": 1_000_000.0, "max_pulse_s": 5.0, "max_base_speed_m_s": 1.0,
        "tank_reserve_ml": 50_000.0, "min_pressure_bar": 20.0, "battery_low_v": 100.0,
    }  # fmt: skip
    for name, bound in bounds.items():
        assert getattr(replace(LIMITS, **{name: bound}), name) == bound
        with pytest.raises(ValueError, match=f"{name} must be between 0 and"):
            replace(LIMITS, **{name: bound * 1.001})


def test_the_voltage_that_stops_is_not_above_the_one_that_pauses():
    assert replace(LIMITS, battery_low_v=22.0, battery_stop_v=22.0).battery_stop_v == 22.0
    with pytest.raises(ValueError, match=r"battery_stop_v \(23\.0\) must not exceed battery_low_v \(22\.0\)"):
        replace(LIMITS, battery_low_v=22.0, battery_stop_v=23.0)

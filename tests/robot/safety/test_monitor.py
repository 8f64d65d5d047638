from dataclasses import replace

import pytest

from robot.safety import Booking, Lease, Mode, SafetyState, watch

from .test_envelope import GOOD, LIMITS, NOW_S

WATCHED = replace(LIMITS, battery_low_v=22.8, battery_stop_v=21.6)
CASES = [
    # fault, one input, the mode it makes of AUTO, words
    ("F08", {"valve_coil": True}, Mode.SAFE_STOP, "though nobody opened it"),
    ("F12", {"arm_errors": (0, 0x20, 0)}, Mode.SAFE_STOP, "0x00 0x20 0x00"),
    ("F13", {"arm_torque_on": False}, Mode.SAFE_STOP, "lost its torque"),
    ("F59", {"bumper_pressed": True}, Mode.SAFE_STOP, "bumper"),
    ("F63", {"fence_margin_m": -0.01}, Mode.SAFE_STOP, "0.01 m outside"),
    ("F63", {"fence_margin_m": float("nan")}, Mode.SAFE_STOP, "geofence"),
    ("F64", {"tilt_rad": 0.44}, Mode.SAFE_STOP, "0.44 rad"),
    ("F64", {"tilt_rad": float("nan")}, Mode.SAFE_STOP, "tilts"),
    ("F65", {"tank_left_ml": 214.9}, Mode.PAUSED, "refill"),
    ("F65", {"tank_left_ml": float("nan")}, Mode.PAUSED, "refill"),
    ("F69", {"battery_v": 22.7}, Mode.PAUSED, "22.7 V"),
    ("F70l", {"estop_pressed": True}, Mode.ESTOP, "e-stop"),
]


@pytest.mark.parametrize(("fault_id", "change", "mode", "words"), CASES)
def test_a_reading_shows_its_fault_and_acts(fault_id, change, mode, words):
    state = watch(SafetyState(mode=Mode.AUTO), replace(GOOD, **change), WATCHED, NOW_S)
    assert [fault.id for fault in state.faults] == [fault_id]
    assert words in state.faults[0].text
    assert state.mode is mode


@pytest.mark.parametrize(
    "change", [{"tilt_rad": 0.43}, {"tank_left_ml": 215.0}, {"battery_v": 22.8}, {"fence_margin_m": 0.0}]
)
def test_a_reading_at_its_limit_shows_nothing(change):
    state = watch(SafetyState(mode=Mode.AUTO), replace(GOOD, **change), WATCHED, NOW_S)
    assert state == SafetyState(mode=Mode.AUTO)


def test_an_empty_battery_stops_and_a_low_one_stands_beside_it():
    state = watch(SafetyState(mode=Mode.AUTO), replace(GOOD, battery_v=21.5), WATCHED, NOW_S)
    assert [fault.id for fault in state.faults] == ["F69", "F69b"]
    assert state.mode is Mode.SAFE_STOP


def test_the_estop_counts_in_every_mode_and_the_rest_only_while_energised():
    bad = replace(
        GOOD, valve_coil=True, bumper_pressed=True, fence_margin_m=-1.0, tilt_rad=1.0, tank_left_ml=0.0, battery_v=0.0,
        base_speed_m_s=1.0, arm_torque_on=False, arm_errors=(1,),
    )  # fmt: skip
    for mode in (Mode.DISARMED, Mode.SAFE_STOP, Mode.ESTOP):
        state = watch(SafetyState(mode=mode, rolling_since_s=0.0), bad, WATCHED, NOW_S)
        assert state.faults == ()
        assert state.mode is mode
        assert watch(state, replace(bad, estop_pressed=True), WATCHED, NOW_S).mode is Mode.ESTOP
    ready = watch(SafetyState(mode=Mode.READY, rolling_since_s=0.0), bad, WATCHED, NOW_S)
    assert {fault.id for fault in ready.faults} == {"F08", "F12", "F13", "F21", "F59", "F63", "F64", "F69", "F69b"}


def test_what_the_readings_show_no_more_is_cleared_where_its_row_allows_it():
    state = watch(SafetyState(mode=Mode.AUTO), replace(GOOD, tank_left_ml=100.0), WATCHED, NOW_S)
    assert state.mode is Mode.PAUSED
    assert watch(state, replace(GOOD, tank_left_ml=100.0), WATCHED, NOW_S + 1.0).faults == state.faults
    state = watch(state, GOOD, WATCHED, NOW_S + 2.0)
    assert state.faults == ()
    assert state.mode is Mode.PAUSED  # it goes on when somebody, or the policy, says so
    stopped = watch(SafetyState(mode=Mode.AUTO), replace(GOOD, bumper_pressed=True), WATCHED, NOW_S)
    assert watch(stopped, GOOD, WATCHED, NOW_S).faults == stopped.faults


def test_the_coil_of_a_shot_under_way_is_no_fault():
    state = SafetyState(mode=Mode.AUTO, bookings=(Booking(1, NOW_S, 7, 5.5, True),))
    assert watch(state, replace(GOOD, valve_coil=True), WATCHED, NOW_S).faults == ()
    done = SafetyState(mode=Mode.AUTO, bookings=(Booking(1, NOW_S, 7, 4.0, False),))
    assert [fault.id for fault in watch(done, replace(GOOD, valve_coil=True), WATCHED, NOW_S).faults] == ["F08"]


def test_a_base_that_rolls_on_after_its_braking_time_is_a_fault():
    state = SafetyState(mode=Mode.AUTO)
    for speed_m_s in (0.06, -0.06):
        rolling = replace(GOOD, base_speed_m_s=speed_m_s)
        first = watch(state, rolling, WATCHED, NOW_S)
        assert first.rolling_since_s == NOW_S
        assert watch(first, rolling, WATCHED, NOW_S + 1.5).faults == ()
        late = watch(first, rolling, WATCHED, NOW_S + 1.51)
        assert [fault.id for fault in late.faults] == ["F21"]
        assert late.mode is Mode.SAFE_STOP
        assert watch(first, replace(rolling, base_commanded=True), WATCHED, NOW_S + 1.0).rolling_since_s is None
        assert watch(first, GOOD, WATCHED, NOW_S + 1.0).rolling_since_s is None
    assert watch(state, replace(GOOD, base_speed_m_s=0.05), WATCHED, NOW_S).rolling_since_s is None


def test_by_hand_a_lost_heartbeat_is_a_fault_until_it_is_back():
    state = SafetyState(mode=Mode.MANUAL, lease=Lease("tablet", 0.0, NOW_S))
    assert watch(state, GOOD, WATCHED, NOW_S + 0.5).faults == ()
    lost = watch(state, GOOD, WATCHED, NOW_S + 0.51)
    assert [fault.id for fault in lost.faults] == ["F70i"]
    assert lost.mode is Mode.MANUAL
    assert watch(replace(lost, lease=Lease("tablet", 0.0, NOW_S + 1.0)), GOOD, WATCHED, NOW_S + 1.0).faults == ()
    nobody = watch(SafetyState(mode=Mode.MANUAL), GOOD, WATCHED, NOW_S)
    assert [fault.id for fault in nobody.faults] == ["F70i"]
    assert watch(SafetyState(mode=Mode.AUTO), GOOD, WATCHED, NOW_S).faults == ()


def test_outside_of_the_geofence_an_operator_may_drive_back():
    state = SafetyState(mode=Mode.MANUAL, lease=Lease("tablet", 0.0, NOW_S))
    assert watch(state, replace(GOOD, fence_margin_m=-1.0), WATCHED, NOW_S).faults == ()

"""Joints and servos: the way between angles and ticks, what cannot be, and where braking ends."""

from __future__ import annotations

import itertools
import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.arm.braking import stop_angle
from drivers.arm.control_tables import MODELS, TICK_RAD, VELOCITY_UNIT_RAD_S, OperatingMode, hardware_error_text
from drivers.arm.joints import DynamixelSettings, JointSettings, ServoSettings
from drivers.arm.register_blocks import Stopping

LIMITS = (-3.0, 3.0)


def settings_of(*joints: JointSettings, **changes: Any) -> DynamixelSettings:
    told: dict[str, Any] = {"joints": joints, "max_velocity_rad_s": 1.5, "max_acceleration_rad_s2": 4.0}
    return DynamixelSettings(**told | changes)


def joint(*servos: ServoSettings, low: float = LIMITS[0], high: float = LIMITS[1]) -> JointSettings:
    return JointSettings("waist", servos, low, high)


@given(angle=st.floats(*LIMITS), turned=st.booleans(), zero=st.integers(-5000, 5000))
def test_an_angle_comes_back_from_its_tick(angle: float, turned: bool, zero: int) -> None:
    servo = ServoSettings(1, "XM430-W350", turned, zero)
    assert abs(servo.angle_of(servo.tick_of(angle)) - angle) <= 0.5 * TICK_RAD + 1e-12


@given(angle=st.floats(*LIMITS))
def test_a_mirrored_servo_gets_the_mirrored_goal(angle: float) -> None:
    pair = joint(ServoSettings(2, "XM540-W270"), ServoSettings(3, "XM540-W270", reversed=True))
    ticks = settings_of(pair).ticks_of([angle])
    assert ticks[2] + ticks[3] == 4096


def test_in_position_mode_a_half_turn_is_the_last_tick() -> None:
    whole = joint(ServoSettings(1, "XM430-W350"), low=-math.pi, high=math.pi)
    assert settings_of(whole, operating_mode=OperatingMode.POSITION).ticks_of([math.pi]) == {1: 4095}
    assert settings_of(whole).ticks_of([math.pi]) == {1: 4096}


@pytest.mark.parametrize(
    ("joints", "changes", "text"),
    [
        ((), {}, "one or two servos"),
        ((joint(),), {}, "one or two servos"),
        ((joint(ServoSettings(1, "XM430-W350"), ServoSettings(1, "XM430-W350")),), {}, "servo id 1 stands at two"),
        ((joint(ServoSettings(1, "AX-12")),), {}, "unknown model 'AX-12'; known are XL430-W250"),
        ((joint(ServoSettings(1, "XM430-W350"), low=1.0, high=0.0),), {}, "lower limit below"),
        ((joint(ServoSettings(1, "XM430-W350")),), {"watchdog_s": 2.0}, "watchdog of 0.2 to 0.5 s"),
        ((joint(ServoSettings(1, "XM430-W350")),), {"torque_on_close": "maybe"}, "hold or off"),
        (
            (joint(ServoSettings(1, "XM430-W350", zero_tick=0)),),
            {"operating_mode": OperatingMode.POSITION},
            "use extended position mode",
        ),
    ],
)
def test_what_cannot_be_is_refused(joints: tuple[JointSettings, ...], changes: dict[str, Any], text: str) -> None:
    with pytest.raises(ValueError, match=text):
        settings_of(*joints, **changes)


def seen(**changes: int) -> Stopping:
    told = {"goal": 2048, "velocity": 0, "position": 2048, "velocity_trajectory": 0, "position_trajectory": 2048}
    return Stopping(**told | changes)


SERVO = ServoSettings(1, "XM430-W350")


def test_a_joint_at_rest_gets_no_goal() -> None:
    assert stop_angle(joint(SERVO), SERVO, seen(position=2051, velocity=1), 0.002, 4.0) is None


def test_a_joint_held_up_far_from_its_goal_stops_where_it_is() -> None:
    angle = stop_angle(joint(SERVO), SERVO, seen(goal=2500, position_trajectory=2500), 0.0, 4.0)
    assert angle == pytest.approx(0.0)


@given(units=st.integers(-60, 60).filter(lambda units: abs(units) > 2), turned=st.booleans())
def test_braking_needs_what_the_limit_allows(units: int, turned: bool) -> None:
    servo = ServoSettings(1, "XM430-W350", turned)
    angle = stop_angle(joint(servo), servo, seen(velocity=units, velocity_trajectory=units, goal=2200), 0.0, 4.0)
    speed = servo.direction * units * VELOCITY_UNIT_RAD_S
    assert angle == pytest.approx(speed * abs(speed) / 8.0)


@given(units=st.integers(-200, 200), place=st.integers(0, 4096), streamed=st.none() | st.floats(-2.0, 2.0))
def test_no_stop_lies_beyond_the_joints_limits(units: int, place: int, streamed: float | None) -> None:
    now = seen(velocity=units, velocity_trajectory=units, position=place, position_trajectory=place)
    angle = stop_angle(joint(SERVO), SERVO, now, 0.005, 4.0, streamed)
    assert angle is None or LIMITS[0] <= angle <= LIMITS[1]


def test_all_models_hold_what_is_read_together_at_the_same_places() -> None:
    for model in MODELS.values():
        at = {name: register.address for name, register in model.registers.items()}
        effort = at.get("present_current", at.get("present_load"))
        assert [effort, at["present_velocity"], at["present_position"]] == [126, 128, 132]
        assert [at["torque_enable"], at["hardware_error_status"], at["bus_watchdog"]] == [64, 70, 98]
        assert [at["profile_acceleration"], at["profile_velocity"], at["goal_position"]] == [108, 112, 116]
        spans = sorted((register.address, register.end) for register in model.registers.values())
        assert all(end <= begin for (_, end), (begin, _) in itertools.pairwise(spans))
        assert math.isfinite(model.stall_n_m)


def test_hardware_errors_are_told_by_name() -> None:
    assert hardware_error_text(0) == "none"
    assert hardware_error_text(0x24) == "0x24 (overheating, overload)"

"""Wheel speeds and base motion are two ways to say the same."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.wheels.drive_geometry import (
    LongCount,
    Mounting,
    WheelPair,
    base_motion,
    count_m,
    ramp_ms,
    rpm_of,
    speed_of,
    wheel_speeds,
)

SPEEDS = st.floats(-1.0, 1.0)
YAW_RATES = st.floats(-2.0, 2.0)
TRACKS = st.floats(0.1, 3.0)
RADII = st.floats(0.03, 1.0)
MOUNTINGS = st.builds(Mounting, st.booleans(), st.booleans(), st.booleans())


@given(SPEEDS, YAW_RATES, TRACKS, RADII)
def test_the_wheels_turn_as_the_base_moves_and_the_base_moves_as_the_wheels_turn(
    speed: float, yaw_rate: float, track: float, radius: float
) -> None:
    wheels = wheel_speeds(speed, yaw_rate, track, 100.0)
    rpm = WheelPair(rpm_of(wheels.left, radius), rpm_of(wheels.right, radius))
    back = base_motion(WheelPair(speed_of(rpm.left, radius), speed_of(rpm.right, radius)), track)
    assert back == pytest.approx((speed, yaw_rate), abs=1e-9)


@given(SPEEDS, YAW_RATES, TRACKS, st.floats(0.01, 1.0))
def test_no_wheel_is_asked_for_more_than_it_can_and_the_curve_stays(
    speed: float, yaw_rate: float, track: float, highest: float
) -> None:
    wheels = wheel_speeds(speed, yaw_rate, track, highest)
    assert max(abs(wheels.left), abs(wheels.right)) <= highest * (1 + 1e-9)
    slower, turned = base_motion(wheels, track)
    assert slower * yaw_rate == pytest.approx(turned * speed, abs=1e-9)


def test_a_turn_to_the_left_runs_the_right_wheel_forward() -> None:
    assert wheel_speeds(0.0, 1.0, 0.5, 1.0) == WheelPair(-0.25, 0.25)


@given(MOUNTINGS, SPEEDS, SPEEDS)
def test_what_the_channels_get_comes_back_as_the_wheels_had_it(mounting: Mounting, left: float, right: float) -> None:
    assert mounting.wheels(mounting.channels(WheelPair(left, right))) == WheelPair(left, right)


def test_as_bought_the_right_channel_turns_backwards_for_forward() -> None:
    assert Mounting().channels(WheelPair(5.0, 7.0)) == WheelPair(5.0, -7.0)


def test_swapped_cables_give_each_wheel_the_other_channel() -> None:
    assert Mounting(swapped=True).channels(WheelPair(5.0, 7.0)) == WheelPair(-7.0, 5.0)


def test_one_turn_of_a_wheel_is_its_circumference() -> None:
    assert 4096 * count_m(0.1, 4096) == pytest.approx(math.tau * 0.1)
    assert speed_of(60.0, 0.1) == pytest.approx(math.tau * 0.1)


def test_a_ramp_is_never_steeper_than_wanted() -> None:
    assert ramp_ms(0.5, 0.5) == 1000
    assert ramp_ms(0.5, 0.3) == 1667


@given(st.integers(-(2**40), 2**40), st.lists(st.integers(-(2**31) + 1, 2**31 - 1), max_size=20))
def test_a_counter_is_followed_beyond_its_wrap(start: int, steps: list[int]) -> None:
    def shown(count: int) -> int:
        return (count + 2**31) % 2**32 - 2**31

    count, at = start, LongCount(shown(start))
    offset = start - at.value
    for step in steps:
        count += step
        assert at.follow(shown(count)) + offset == count


def test_a_counter_that_was_set_back_shows_zero() -> None:
    at = LongCount(123_456)
    assert at.follow(0) == 0

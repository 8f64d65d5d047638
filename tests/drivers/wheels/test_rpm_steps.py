"""Whole rpm that add up to speeds between them."""

from __future__ import annotations

from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.wheels.rpm_steps import RpmSteps

LONGEST_S = 0.5
PERIODS = st.lists(st.floats(0.01, 0.2), min_size=2, max_size=100)


def turned_rpm_s(wanted: list[float], periods: list[float]) -> tuple[float, float]:
    """What the wheel was to turn and what it was commanded to, both over all periods."""
    steps, now_s, due, done = RpmSteps(LONGEST_S), 0.0, 0.0, 0.0
    for rpm, period in zip(wanted, periods, strict=True):
        done += steps.next(rpm, now_s) * period
        due += rpm * period
        now_s += period
    return due, done


@given(st.floats(-100.0, 100.0), PERIODS)
def test_the_wheel_never_owes_more_than_one_rpm_of_one_command(rpm: float, periods: list[float]) -> None:
    due, done = turned_rpm_s([rpm] * len(periods), periods)
    assert abs(due - done) <= 1.0 * max(periods) + 1e-6


@given(st.lists(st.tuples(st.floats(-100.0, 100.0).filter(bool), st.floats(0.01, 0.2)), min_size=2, max_size=100))
def test_nor_does_it_while_the_speed_changes(course: list[tuple[float, float]]) -> None:
    due, done = turned_rpm_s([rpm for rpm, _ in course], [period for _, period in course])
    assert abs(due - done) <= 2.0 * max(period for _, period in course) + 1e-6


@given(st.floats(-100.0, 100.0), PERIODS)
def test_every_command_is_the_step_below_or_above(rpm: float, periods: list[float]) -> None:
    steps, now_s = RpmSteps(LONGEST_S), 0.0
    for period in periods:
        assert abs(steps.next(rpm, now_s) - rpm) < 1.0
        now_s += period


@pytest.mark.parametrize("rpm", [0.05, 0.2, 0.5, 0.95, 23.87, -0.3])
def test_the_mean_over_ten_seconds_is_the_wanted_speed(rpm: float) -> None:
    due, done = turned_rpm_s([rpm] * 200, [0.05] * 200)
    assert done / 10.0 == pytest.approx(due / 10.0, abs=0.005)


def test_a_whole_speed_is_commanded_as_it_is() -> None:
    steps = RpmSteps(LONGEST_S)
    assert [steps.next(24.0, 0.05 * k) for k in range(20)] == [24] * 20


def test_zero_is_zero_at_once_and_forgives_the_debt() -> None:
    steps = RpmSteps(LONGEST_S)
    for k in range(7):
        steps.next(0.3, 0.05 * k)
    assert steps.next(0.0, 0.35) == 0
    assert steps.debt_rpm_s == 0.0
    assert [steps.next(0.0, 0.4 + 0.05 * k) for k in range(5)] == [0] * 5


def test_a_long_silence_counts_no_longer_than_the_controller_obeys() -> None:
    steps = RpmSteps(LONGEST_S)
    steps.next(0.4, 0.0)
    steps.next(0.4, 100.0)
    assert steps.debt_rpm_s == pytest.approx(0.4 * LONGEST_S)


def test_steps_of_a_slow_wheel_are_spread_and_not_bunched() -> None:
    steps = RpmSteps(LONGEST_S)
    ones = [k for k in range(100) if steps.next(0.25, 0.05 * k) == 1]
    assert all(3 <= later - earlier <= 5 for earlier, later in pairwise(ones))

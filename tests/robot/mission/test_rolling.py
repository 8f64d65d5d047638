import pytest

from drivers.errors import DeviceFault
from drivers.wheels.values import Odometry
from robot.mission.rolling import WITHIN_S, RollingWatch


def told(*readings: tuple[float, float, float]) -> RollingWatch:
    """(stamp, counter of both wheels, commanded speed) one after another."""
    watch = RollingWatch()
    for stamp_s, counted_m, commanded_m_s in readings:
        watch.check(Odometry(stamp_s, counted_m, counted_m, 0.0, 0.0), commanded_m_s)
    return watch


def test_wheels_that_creep_at_one_centimetre_a_second_are_believed():
    told(*((0.05 * k, 0.01 * 0.05 * k, 0.01) for k in range(100)))


def test_wheels_that_count_nothing_while_they_are_driven_are_a_fault():
    with pytest.raises(DeviceFault, match=r"counters that move while 0\.20 m/s are commanded, found no change in 0\.6"):
        told(*((0.05 * k, 1.0, 0.20) for k in range(100)))


def test_wheels_that_are_told_to_stand_may_stand():
    told(*((0.05 * k, 1.0, 0.0) for k in range(100)))


def test_the_time_counts_from_the_last_standstill_that_was_asked_for():
    told((0.0, 1.0, 0.0), (5.0, 1.0, 0.0), (5.0 + 0.9 * WITHIN_S, 1.0, 0.2))


def test_one_wheel_that_turns_is_enough_to_turn_about_the_other():
    watch = RollingWatch()
    for k in range(100):
        watch.check(Odometry(0.05 * k, 0.0, 0.002 * k, 0.0, 0.0), 0.1)
    with pytest.raises(DeviceFault):
        watch.check(Odometry(6.0, 0.0, 0.198, 0.0, 0.0), 0.1)

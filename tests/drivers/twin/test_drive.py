"""The base on the ground."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from drivers.twin import TrueMachine, draw, exact
from drivers.twin.drive import Drive
from tests.drivers.twin import rig

NOMINAL = rig.nominal()


def drive(true: TrueMachine | None = None, seed: int = 1) -> Drive:
    return Drive(NOMINAL, true or exact(NOMINAL), seed)


def keep(base: Drive, seconds: float, speed: float, yaw_rate: float = 0.0, begin_s: float = 0.0) -> float:
    """Renew a command at 10 Hz, then stop and wait; returns the time."""
    for k in range(round(seconds * 10)):
        base.advance(begin_s + 0.1 * k)
        base.command(begin_s + 0.1 * k, speed, yaw_rate)
    end_s = begin_s + seconds
    base.advance(end_s)
    base.stop(end_s)
    base.advance(end_s + 2.0)
    return end_s + 2.0


def rolled_m(base: Drive) -> float:
    return 0.5 * sum(base.counters_m)


def test_speed_changes_within_the_acceleration_limit() -> None:
    base = drive()
    base.command(0.0, 0.4, 0.0)
    base.advance(0.2)
    assert base.speeds_m_s[0] == pytest.approx(0.2 * NOMINAL.max_acceleration_m_s2)


def test_a_command_beyond_the_wheels_is_scaled_down_and_keeps_its_curve() -> None:
    base = drive()
    for k in range(30):
        base.advance(0.1 * k)
        base.command(0.1 * k, 2.0, 1.0)
    speed, yaw_rate = base.speeds_m_s
    assert speed + 0.5 * NOMINAL.track_m * yaw_rate == pytest.approx(NOMINAL.max_speed_m_s)
    assert yaw_rate / speed == pytest.approx(0.5)


def test_a_larger_wheel_goes_farther_than_it_counts() -> None:
    true = replace(exact(NOMINAL), wheel_radius_m=(0.101, 0.101))
    base, other = drive(true), drive()
    keep(base, 10.0, 0.3)
    keep(other, 10.0, 0.3)
    assert base.counters_m == other.counters_m
    assert base.pose[0] / other.pose[0] == pytest.approx(1.01)


def test_slip_loses_a_little_of_every_metre() -> None:
    base = drive()
    keep(base, 20.0, 0.4)
    lost = 1.0 - base.pose[0] / rolled_m(base)
    assert 0.0 < lost < 0.01


def test_the_ground_slips_alike_for_the_same_seed_and_otherwise_for_another() -> None:
    bases = [drive(seed=seed) for seed in (1, 1, 2)]
    for base in bases:
        keep(base, 10.0, 0.3)
    assert bases[0].pose == bases[1].pose != bases[2].pose


def test_a_full_turn_comes_back_to_the_heading() -> None:
    base = drive()
    keep(base, 4.0, 0.0, 0.6)
    left, right = base.counters_m
    assert base.pose[2] == pytest.approx((right - left) / NOMINAL.track_m, rel=0.01)
    assert math.hypot(*base.pose[:2]) < 0.005


def test_a_shove_moves_the_base_and_not_the_counters() -> None:
    base = drive()
    base.push(0.0, 0.0, math.pi / 2)
    base.push(0.1, 0.02, 0.0)
    assert base.pose == pytest.approx((-0.02, 0.1, math.pi / 2))
    assert base.counters_m == (0.0, 0.0)


def test_without_power_the_base_brakes_and_stays() -> None:
    base = drive()
    base.command(0.0, 0.4, 0.0)
    base.advance(0.4)
    base.powered = False
    rested_s = base.advance(5.0)
    assert rested_s is not None
    assert rested_s < 1.0
    assert base.resting


def test_standing_counters_read_alike_and_rolling_ones_jitter() -> None:
    base = drive()
    noise = np.random.default_rng(0)
    keep(base, 1.0, 0.2)
    assert len({base.reading(3.0, noise).left_m for _ in range(5)}) == 1
    base.command(3.0, 0.2, 0.0)
    base.advance(3.3)
    assert len({base.reading(3.3, noise).left_m for _ in range(20)}) > 1


def test_the_drawn_wheels_differ_by_a_percent_at_most() -> None:
    for seed in range(20):
        for radius in draw(NOMINAL, seed).wheel_radius_m:
            assert radius / NOMINAL.wheel_radius_m == pytest.approx(1.0, abs=0.011)


def test_a_controller_that_was_set_keeps_to_its_own_ramps_and_time_out() -> None:
    base = drive()
    base.set_ramps(0.2, 0.8, 10.0)
    base.command(0.0, 0.4, 0.0)
    base.advance(1.0)
    assert base.speeds_m_s[0] == pytest.approx(0.2)
    base.command(1.0, 0.0, 0.0)
    base.advance(1.1)
    assert base.speeds_m_s[0] == pytest.approx(0.12)
    base.command(1.1, 0.1, 0.0)
    base.advance(11.0)
    assert base.speeds_m_s[0] == pytest.approx(0.1)
    base.advance(12.0)
    assert base.resting

from __future__ import annotations

import numpy as np
import pytest

from robot.aiming import MotionLimits, joint_trajectory, travel_time_s

LIMITS = MotionLimits(np.full(6, 1.5), np.full(6, 4.0))
HOME = np.zeros(6)
AWAY = np.array([1.2, -0.4, 0.9, 0.0, -0.2, 0.1])


def test_a_long_move_cruises_at_the_speed_limit_of_its_busiest_joint() -> None:
    assert travel_time_s(AWAY, LIMITS) == pytest.approx(1.2 / 1.5 + 1.5 / 4.0)


def test_a_short_move_only_speeds_up_and_slows_down() -> None:
    assert travel_time_s(0.1 * AWAY, LIMITS) == pytest.approx(2 * np.sqrt(0.12 / 4.0))


def test_the_slowest_joint_sets_the_speed_and_the_busiest_the_ramps() -> None:
    slow = MotionLimits(np.array([1.5, 0.1, 1.5, 1.5, 1.5, 1.5]), np.full(6, 4.0))
    assert travel_time_s(AWAY, slow) == pytest.approx(0.4 / 0.1 + (1.2 / 0.4) * 0.1 / 4.0)


def test_no_move_takes_no_time() -> None:
    assert travel_time_s(HOME, LIMITS) == 0.0
    standing = joint_trajectory(np.stack([AWAY, AWAY]), LIMITS, 0.02)
    assert standing.times_s == (0.0,)
    assert standing.goal_rad == tuple(AWAY)


def test_a_trajectory_is_hardly_slower_than_the_fastest_move() -> None:
    trajectory = joint_trajectory(np.stack([HOME, AWAY]), LIMITS, 0.02)
    fastest_s = float(travel_time_s(AWAY, LIMITS))
    assert fastest_s <= trajectory.duration_s < fastest_s + 0.02 + 1e-9


def test_all_joints_are_on_the_straight_line_together() -> None:
    positions = np.array(joint_trajectory(np.stack([HOME, AWAY]), LIMITS, 0.02).positions_rad)
    shares = positions[:, 0] / AWAY[0]
    assert positions == pytest.approx(shares[:, None] * AWAY, abs=1e-12)
    assert (np.diff(shares) > 0).all()


def test_via_points_are_samples_where_the_arm_rests() -> None:
    via = np.array([0.5, 0.5, 0.0, 0.0, 0.0, 0.0])
    trajectory = joint_trajectory(np.stack([HOME, via, AWAY]), LIMITS, 0.02)
    positions = np.array(trajectory.positions_rad)
    at = int(np.abs(positions - via).max(axis=1).argmin())
    assert (positions[at] == via).all()
    speed = np.abs(np.diff(positions, axis=0)).max(axis=1) / 0.02
    assert max(speed[at - 1], speed[at]) <= 4.0 * 0.02


def test_samples_come_every_20_ms() -> None:
    trajectory = joint_trajectory(np.stack([HOME, AWAY]), LIMITS, 0.02)
    assert np.diff(trajectory.times_s) == pytest.approx(0.02)

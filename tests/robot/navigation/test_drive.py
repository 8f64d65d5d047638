"""The base stops where it should, and brakes no harder than it may."""

from __future__ import annotations

import itertools

import pytest

from robot.geometry import Pose2
from robot.navigation import DriveLimits, PoseFilter, command, predict, start
from tests.robot.navigation.rover import TRACK_M, Rover, drive_to

LIMITS = DriveLimits()


def at_rest(rover: Rover) -> None:
    rover.run(0.0, 0.0, 1.0)


@pytest.mark.parametrize("goal_x_m", [0.01, 0.1, 0.4, 1.0])
@pytest.mark.parametrize("lag_s", [0.0, 0.05, 0.08, 0.12])
def test_base_stops_within_5_mm_of_the_goal(goal_x_m: float, lag_s: float) -> None:
    rover = Rover(lag_s=lag_s)
    drive_to(rover, start(Pose2(0.0, 0.0, 0.0), rover.odometry(), TRACK_M), goal_x_m, LIMITS)
    at_rest(rover)
    assert rover.x_m == pytest.approx(goal_x_m, abs=0.005)


def test_base_goes_back_when_it_stands_past_the_goal() -> None:
    rover = Rover()
    drive_to(rover, start(Pose2(0.0, 0.0, 0.0), rover.odometry(), TRACK_M), -0.05, LIMITS)
    at_rest(rover)
    assert rover.x_m == pytest.approx(-0.05, abs=0.005)


def test_a_stop_of_40_cm_takes_less_than_4_seconds() -> None:
    rover = Rover()
    drive_to(rover, start(Pose2(0.0, 0.0, 0.0), rover.odometry(), TRACK_M), 0.4, LIMITS)
    assert rover.now_s < 4.0


def test_speed_and_both_accelerations_stay_inside_their_limits() -> None:
    rover, speeds = Rover(), [0.0]

    def note(rover: Rover, pose_filter: PoseFilter) -> PoseFilter:
        speeds.append(rover.speed_m_s)
        return pose_filter

    drive_to(rover, start(Pose2(0.0, 0.0, 0.0), rover.odometry(), TRACK_M), 1.0, LIMITS, note)
    changes = [(b - a) / LIMITS.period_s for a, b in itertools.pairwise(speeds)]
    assert max(speeds) <= LIMITS.max_speed_m_s + 1e-9
    assert max(changes) <= LIMITS.max_acceleration_m_s2 * 1.01
    assert min(changes) >= -LIMITS.max_deceleration_m_s2 * 1.01


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_base_comes_back_to_the_lane_and_its_heading(way: float) -> None:
    rover = Rover(y_m=0.06, heading_rad=0.05)
    pose_filter = start(rover.pose, rover.odometry(), TRACK_M)
    drive_to(rover, pose_filter, 4.0 * way, LIMITS)
    assert abs(rover.y_m) < 0.005
    assert abs(rover.heading_rad) < 0.01


def test_base_keeps_to_a_lane_beside_the_origin() -> None:
    rover = Rover()
    pose_filter = start(rover.pose, rover.odometry(), TRACK_M)
    for _ in range(600):
        pose_filter = predict(pose_filter, rover.odometry())
        order = command(pose_filter.pose, 4.0, rover.speed_m_s, rover.speed_m_s, LIMITS, lane_y_m=0.03)
        rover.run(order.speed_m_s, order.yaw_rate_rad_s, LIMITS.period_s)
    assert rover.y_m == pytest.approx(0.03, abs=0.005)


def test_arrived_means_near_and_standing() -> None:
    assert command(Pose2(1.0, 0.0, 0.0), 1.001, 0.0, 0.0, LIMITS).arrived
    rolling = command(Pose2(1.0, 0.0, 0.0), 1.001, 0.1, 0.1, LIMITS)
    assert not rolling.arrived
    assert rolling.speed_m_s == 0.0


def test_yaw_rate_is_bounded() -> None:
    order = command(Pose2(0.0, 3.0, 1.5), 4.0, 0.25, 0.25, LIMITS)
    assert abs(order.yaw_rate_rad_s) <= LIMITS.max_yaw_rate_rad_s


@pytest.mark.parametrize("wrong", [{"max_speed_m_s": 0.0}, {"lag_s": -0.1}, {"period_s": float("inf")}])
def test_impossible_limits_are_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(ValueError):
        DriveLimits(**wrong)

"""Driving to a stop along the row: a trapezoid in speed, a straight line in the lane."""

from __future__ import annotations

import math
from dataclasses import dataclass

from robot.geometry import Pose2


@dataclass(frozen=True, slots=True)
class DriveLimits:
    """What the base may do, and how the controller is tuned.

    ``lag_s`` is the time from a command to the base's speed; ``period_s`` the time between commands. ``reach_m`` is
    the distance in which the base returns to the lane's centre line. ``tolerance_m`` and ``still_m_s`` say arrived.
    """

    max_speed_m_s: float = 0.25
    max_deceleration_m_s2: float = 0.3
    max_acceleration_m_s2: float = 0.3
    max_yaw_rate_rad_s: float = 0.4
    lag_s: float = 0.08
    period_s: float = 0.05
    reach_m: float = 0.5
    tolerance_m: float = 0.003
    still_m_s: float = 0.01
    creep_m_s: float = 0.01

    def __post_init__(self) -> None:
        positive = (
            self.max_speed_m_s,
            self.max_deceleration_m_s2,
            self.max_acceleration_m_s2,
            self.max_yaw_rate_rad_s,
            self.period_s,
            self.reach_m,
            self.tolerance_m,
            self.still_m_s,
            self.creep_m_s,
        )
        if not all(0.0 < value < math.inf for value in positive) or not 0.0 <= self.lag_s < 1.0:
            raise ValueError(f"drive limits must be positive and finite, found {self}")


@dataclass(frozen=True, slots=True)
class DriveCommand:
    """Speed forward, rate of turn to the left, and whether the base stands at the goal (then both are 0)."""

    speed_m_s: float
    yaw_rate_rad_s: float
    arrived: bool


def command(
    pose: Pose2, goal_x_m: float, speed_m_s: float, commanded_m_s: float, limits: DriveLimits, lane_y_m: float = 0.0
) -> DriveCommand:
    """The next command towards ``goal_x_m``, keeping to ``lane_y_m`` and heading 0.

    ``speed_m_s`` is the present speed (odometry), ``commanded_m_s`` the last command. Past the goal by more than the
    tolerance the base backs up. Steering: d2y/dx2 = -2/L dy/dx - y/L^2 with L = ``reach_m``, critically damped.
    """
    ahead_m = goal_x_m - pose.x_m
    if abs(ahead_m) <= limits.tolerance_m and abs(speed_m_s) <= limits.still_m_s:
        return DriveCommand(0.0, 0.0, True)
    way = math.copysign(1.0, ahead_m)
    coming_m = abs(ahead_m) - max(0.0, way * speed_m_s) * limits.lag_s
    wanted_m_s = _braking_speed(coming_m, limits)
    if abs(ahead_m) <= limits.tolerance_m:
        wanted_m_s = 0.0
    last = way * commanded_m_s
    reach_m_s = last + limits.max_acceleration_m_s2 * limits.period_s
    speed = way * min(wanted_m_s, limits.max_speed_m_s, max(reach_m_s, 0.0))
    bend = -2.0 / limits.reach_m * math.sin(pose.heading_rad) - way * (pose.y_m - lane_y_m) / limits.reach_m**2
    yaw_rate = max(-limits.max_yaw_rate_rad_s, min(limits.max_yaw_rate_rad_s, abs(speed) * bend))
    return DriveCommand(speed, yaw_rate, False)


def _braking_speed(distance_m: float, limits: DriveLimits) -> float:
    """Highest speed from which the base still stops in the distance, at 0.8 of its deceleration; then a creep."""
    if distance_m <= 0.0:
        return 0.0
    deceleration = 0.8 * limits.max_deceleration_m_s2
    step = deceleration * limits.period_s
    fast = math.sqrt(2.0 * deceleration * distance_m + (0.5 * step) ** 2) - 0.5 * step
    return max(fast, min(limits.creep_m_s, distance_m / limits.period_s))

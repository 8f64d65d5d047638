"""A plain rover for the tests: true differential drive with a command lag and a wheel radius that is off."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from drivers.wheels.values import Odometry
from robot.geometry import Pose2
from robot.navigation import DriveLimits, PoseFilter, command, predict

TRACK_M = 0.6
TICK_S = 0.005


@dataclass
class Rover:
    """Truth, advanced by Euler steps of 5 ms; ``radius_error`` is true over nominal radius, less one."""

    radius_error: float = 0.0
    lag_s: float = 0.08
    rng: np.random.Generator = field(default_factory=lambda: np.random.default_rng(0))
    x_m: float = 0.0
    y_m: float = 0.0
    heading_rad: float = 0.0
    speed_m_s: float = 0.0
    yaw_rate_rad_s: float = 0.0
    left_m: float = 0.0
    right_m: float = 0.0
    now_s: float = 0.0

    def run(self, speed_m_s: float, yaw_rate_rad_s: float, duration_s: float) -> None:
        for _ in range(round(duration_s / TICK_S)):
            share = 1.0 - math.exp(-TICK_S / self.lag_s) if self.lag_s else 1.0
            self.speed_m_s += share * (speed_m_s - self.speed_m_s)
            self.yaw_rate_rad_s += share * (yaw_rate_rad_s - self.yaw_rate_rad_s)
            counted_m, turned = self.speed_m_s * TICK_S, self.yaw_rate_rad_s * TICK_S
            self.left_m += counted_m - 0.5 * TRACK_M * turned
            self.right_m += counted_m + 0.5 * TRACK_M * turned
            true = 1.0 + self.radius_error
            self.x_m += true * counted_m * math.cos(self.heading_rad)
            self.y_m += true * counted_m * math.sin(self.heading_rad)
            self.heading_rad += true * turned
            self.now_s += TICK_S

    def odometry(self) -> Odometry:
        left = self.speed_m_s - 0.5 * TRACK_M * self.yaw_rate_rad_s
        right = self.speed_m_s + 0.5 * TRACK_M * self.yaw_rate_rad_s
        return Odometry(self.now_s, self.left_m, self.right_m, left, right)

    @property
    def pose(self) -> Pose2:
        return Pose2(self.x_m, self.y_m, self.heading_rad)


def drive_to(
    rover: Rover,
    pose_filter: PoseFilter,
    goal_x_m: float,
    limits: DriveLimits,
    hook: Callable[[Rover, PoseFilter], PoseFilter] | None = None,
) -> PoseFilter:
    """20 Hz control until arrived; ``hook(rover, filter) -> filter`` runs each period. Fails after 60 s."""
    commanded = 0.0
    for _ in range(1200):
        pose_filter = predict(pose_filter, rover.odometry())
        if hook is not None:
            pose_filter = hook(rover, pose_filter)
        order = command(pose_filter.pose, goal_x_m, rover.odometry().speed_m_s, commanded, limits)
        if order.arrived:
            return pose_filter
        commanded = order.speed_m_s
        rover.run(order.speed_m_s, order.yaw_rate_rad_s, limits.period_s)
    raise AssertionError(f"not arrived at {goal_x_m}: {rover.pose}, {pose_filter.pose}")

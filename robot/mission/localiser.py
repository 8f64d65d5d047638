"""Keeps the pose filter up to date from odometry, satellites and landmarks."""

from __future__ import annotations

import math
from dataclasses import replace

from drivers.errors import DeviceFault
from drivers.gps.values import Fix, FixQuality
from drivers.wheels.values import Odometry
from robot import navigation
from robot.geometry import Pose2
from robot.navigation import Datum, FixRules, PoseFilter

PUSHED_AFTER_FIXES = 5   # refused in a row: a second of RTK
FARTHEST_PUSH_M = 0.3    # what is farther off is taken for a wrong fix


class Localiser:
    """The one owner of the pose. ``start`` it with a known pose, or with a checkpoint's pose and counters."""

    def __init__(self, track_m: float, datum: Datum | None, rules: FixRules) -> None:
        self._track_m = track_m
        self._datum = datum
        self._rules = rules
        self._filter: PoseFilter | None = None

    def start(self, pose: Pose2, odometry: Odometry) -> None:
        self._filter = navigation.start(pose, odometry, self._track_m)

    def resume(self, pose: Pose2, left_m: float, right_m: float, now: Odometry, farthest_m: float) -> None:
        """Go on from a checkpoint: the controller has counted on meanwhile.

        ``DeviceFault`` when the counters moved by more than ``farthest_m``: then they are not the same count.
        """
        moved_m = max(abs(now.left_m - left_m), abs(now.right_m - right_m))
        if moved_m > farthest_m:
            raise DeviceFault(
                "wheels",
                f"counters within {farthest_m} m of the checkpoint ({left_m:.3f}, {right_m:.3f})",
                f"({now.left_m:.3f}, {now.right_m:.3f})",
                "the drive was powered off or the rover was moved: drive to the row's start and begin a new run",
            )
        then = Odometry(now.stamp_s, left_m, right_m, 0.0, 0.0)
        self._filter = navigation.predict(navigation.start(pose, then, self._track_m), now)

    def on_odometry(self, odometry: Odometry) -> None:
        if self._filter is not None and odometry.stamp_s > self._filter.stamp_s:
            self._filter = navigation.predict(self._filter, odometry)

    def on_fix(self, fix: Fix) -> None:
        """Take a fix in. Fixes that odometry contradicts are refused, until so many agree that the rover was pushed."""
        if self._filter is None or self._datum is None:
            return
        before = self._filter
        self._filter = navigation.update_fix(before, fix, self._datum, self._rules)
        if self._filter.rejected > before.rejected and self._filter.rejected >= PUSHED_AFTER_FIXES:
            self._believe(fix, self._datum)

    def _believe(self, fix: Fix, datum: Datum) -> None:
        """Start over where an RTK fix says, when that is no farther off than a push can shift the rover."""
        before = self.filter
        if fix.quality is not FixQuality.RTK_FIXED or fix.latitude_deg is None or fix.longitude_deg is None:
            return
        x_m, y_m = navigation.row_xy_m(fix.latitude_deg, fix.longitude_deg, datum)
        lever = before.pose.transform().rotate((*self._rules.antenna_xy_m, 0.0))
        there = Pose2(x_m - float(lever[0]), y_m - float(lever[1]), before.pose.heading_rad)
        if math.hypot(there.x_m - before.pose.x_m, there.y_m - before.pose.y_m) <= FARTHEST_PUSH_M:
            fresh = navigation.start(there, before.odometry, self._track_m)
            self._filter = replace(fresh, trail=before.trail)

    def on_landmarks(self, seen_from: Pose2, shift: navigation.PoseShift, stamp_s: float) -> None:
        self._filter = navigation.update_landmarks(self.filter, seen_from, shift, stamp_s)

    @property
    def started(self) -> bool:
        return self._filter is not None

    @property
    def filter(self) -> PoseFilter:
        if self._filter is None:
            raise RuntimeError("the localiser has not been started")
        return self._filter

    @property
    def pose(self) -> Pose2:
        return self.filter.pose

    def pose_at(self, stamp_s: float) -> Pose2:
        return navigation.pose_at(self.filter, stamp_s)

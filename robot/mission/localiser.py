"""Keeps the pose filter up to date from odometry, satellites and landmarks."""

from __future__ import annotations

from drivers.errors import DeviceFault
from drivers.gps.values import Fix
from drivers.wheels.values import Odometry
from robot import navigation
from robot.geometry import Pose2
from robot.navigation import Datum, FixRules, PoseFilter


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
        if self._filter is not None and self._datum is not None:
            self._filter = navigation.update_fix(self._filter, fix, self._datum, self._rules)

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

"""How far the arm stays clear of itself, the rover, plant supports and fruit."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from robot.aiming.capsules import Box, Capsule, segment_box_m, segment_point_m, segment_segment_m
from robot.aiming.kinematics import LinkFrames, joint_reach_m, link_frames
from robot.aiming.obstacles import Obstacles
from robot.aiming.urdf import ArmModel
from robot.geometry import Vector

_LEAVING_M = 0.001
_BATCH = 256
_COARSE = 6


class Thing(IntEnum):
    """What an arm capsule is too near to."""

    ARM = 0
    ROVER = 1
    SUPPORT = 2
    FRUIT = 3


@dataclass(frozen=True, slots=True, eq=False)
class Clearances:
    """``gap_m`` (m, p): surface distance of p pairs at m postures (negative: overlap); ``thing`` (p,) their kind."""

    gap_m: Vector
    thing: npt.NDArray[np.int64]

    def least_m(self) -> Vector:
        """(m,) the smallest gap at each posture."""
        return np.asarray(self.gap_m.min(axis=1, initial=np.inf))


class CollisionModel:
    """An arm among obstacles (arm base frame), kept ``margin_m`` apart.

    Pairs: arm links two or more joints apart; every moving link against body, supports and fruit. The root link is
    bolted to the rover and stands for nothing there.
    """

    def __init__(self, model: ArmModel, obstacles: Obstacles, margin_m: float) -> None:
        self.model = model
        self.margin_m = margin_m
        self._links = np.array([item.link for item in model.capsules], dtype=np.int64)
        self._starts = np.stack([item.capsule.start_m for item in model.capsules])
        self._ends = np.stack([item.capsule.end_m for item in model.capsules])
        self._radii = np.array([item.capsule.radius_m for item in model.capsules])
        first, second = np.triu_indices(len(self._links), 1)
        apart = np.abs(self._links[first] - self._links[second]) >= 2
        self._first, self._second = first[apart], second[apart]
        self._moving = np.flatnonzero(self._links > 0)
        self._reach_m = joint_reach_m(model)
        self._boxes = [part for part in obstacles.body if isinstance(part, Box)]
        bars = [(part, Thing.ROVER) for part in obstacles.body if isinstance(part, Capsule)]
        bars += [(part, Thing.SUPPORT) for part in obstacles.supports if self._near(part)]
        self._bar_starts = np.array([bar.start_m for bar, _ in bars]).reshape(-1, 3)
        self._bar_ends = np.array([bar.end_m for bar, _ in bars]).reshape(-1, 3)
        self._bar_radii = np.array([bar.radius_m for bar, _ in bars])
        balls = [ball for ball in obstacles.fruits if self._near(Capsule(ball.centre_m, ball.centre_m, ball.radius_m))]
        self._ball_centres = np.array([ball.centre_m for ball in balls]).reshape(-1, 3)
        self._ball_radii = np.array([ball.radius_m for ball in balls])
        moving = self._moving.size
        self._thing = np.concatenate(
            [
                np.full(self._first.size, Thing.ARM),
                np.full(moving * len(self._boxes), Thing.ROVER),
                np.tile(np.array([kind for _, kind in bars], dtype=np.int64), moving),
                np.full(moving * len(balls), Thing.FRUIT),
            ]
        )

    def clearances(self, joints_rad: Vector) -> Clearances:
        """Gaps of all pairs at ``joints_rad`` (m, n)."""
        angles = np.asarray(joints_rad, dtype=np.float64)
        chunks = [self._gaps(angles[k : k + _BATCH]) for k in range(0, len(angles), _BATCH)]
        return Clearances(np.concatenate(chunks) if chunks else np.empty((0, self._thing.size)), self._thing)

    def touched(self, joints_rad: Vector) -> set[Thing]:
        """What one posture (n,) comes nearer to than the margin."""
        near = self.clearances(np.asarray(joints_rad)[None]).gap_m[0] < self.margin_m
        return {Thing(kind) for kind in np.unique(self._thing[near])}

    def path_is_free(self, way_rad: Vector, step_rad: float, sweep_m: float) -> bool:
        """Whether the straight joint-space pieces between the rows of ``way_rad`` (k, n) keep the margin.

        Checked at steps of at most ``step_rad`` a joint and ``sweep_m`` a point of the arm. A pair nearer than the
        margin at the start may stay so, but must not close by more than 1 mm: the arm can always leave.
        """
        postures = self.steps(way_rad, step_rad, sweep_m)
        return self._keeps_apart(postures[::_COARSE]) and self._keeps_apart(postures)

    def _keeps_apart(self, postures: Vector) -> bool:
        gaps = self.clearances(postures).gap_m
        needed = np.minimum(self.margin_m, gaps[0] - _LEAVING_M)
        return bool((gaps >= needed).all())

    def steps(self, way_rad: Vector, step_rad: float, sweep_m: float) -> Vector:
        """Postures along the pieces of ``way_rad``, both ends included."""
        way = np.asarray(way_rad, dtype=np.float64)
        pieces = [way[:1]]
        for start, end in pairwise(way):
            move = np.abs(end - start)
            count = max(1, int(np.ceil(max(float(move.max()) / step_rad, float(move @ self._reach_m) / sweep_m))))
            pieces.append(start + np.linspace(0.0, 1.0, count + 1)[1:, None] * (end - start))
        return np.concatenate(pieces)

    def placed_capsules(self, joints_rad: Vector) -> tuple[Vector, Vector, Vector]:
        """Capsules of the whole arm at ``joints_rad`` (m, n): starts (m, c, 3), ends (m, c, 3), radii (c,)."""
        return (*self._placed(link_frames(self.model, joints_rad)), self._radii)

    def _gaps(self, angles: Vector) -> Vector:
        starts, ends = self._placed(link_frames(self.model, angles))
        one, two = self._first, self._second
        count = len(angles)
        gaps = [segment_segment_m(starts[:, one], ends[:, one], starts[:, two], ends[:, two])]
        gaps[0] -= self._radii[one] + self._radii[two]
        starts, ends, radii = starts[:, self._moving], ends[:, self._moving], self._radii[self._moving]
        for box in self._boxes:
            gaps.append(segment_box_m(starts, ends, box) - radii)
        if self._bar_radii.size:
            apart = segment_segment_m(starts[:, :, None], ends[:, :, None], self._bar_starts, self._bar_ends)
            gaps.append((apart - radii[:, None] - self._bar_radii).reshape(count, -1))
        if self._ball_radii.size:
            apart = segment_point_m(starts[:, :, None], ends[:, :, None], self._ball_centres)
            gaps.append((apart - radii[:, None] - self._ball_radii).reshape(count, -1))
        return np.concatenate(gaps, axis=1)

    def _placed(self, frames: LinkFrames) -> tuple[Vector, Vector]:
        rotation, origin = frames.rotation[:, self._links], frames.origin_m[:, self._links]
        starts = (rotation @ self._starts[:, :, None])[..., 0] + origin
        ends = (rotation @ self._ends[:, :, None])[..., 0] + origin
        return starts, ends

    def _near(self, part: Capsule) -> bool:
        from_root = segment_point_m(part.start_m, part.end_m, self.model.joints[0].parent_from_joint.translation_m)
        return float(from_root) - part.radius_m < float(self._reach_m.max()) + self.margin_m

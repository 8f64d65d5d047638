"""Whether a stow posture is fit for driving and for looking: clear of everything, inside the rover, out of the view."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from robot.aiming.collision import CollisionModel
from robot.aiming.kinematics import within_limits
from robot.geometry import Transform, Vector


@dataclass(frozen=True, slots=True, eq=False)
class CameraView:
    """The pyramid that one eye sees. ``arm_from_camera``: optical frame (x right, y down, z forward) in the arm's base
    frame; ``image_size`` (width, height); ``K`` (3, 3) pinhole matrix, pixel centres at integers."""

    arm_from_camera: Transform
    image_size: tuple[int, int]
    K: Vector

    def outside_m(self, starts_m: Vector, ends_m: Vector, radii_m: Vector) -> Vector:
        """How far capsules (..., 3), (..., 3), (...) lie outside; a lower bound of the distance, negative inside.

        Each capsule is held against the plane through a side of the pyramid that it is farthest beyond.
        """
        width, height = self.image_size
        left, top, right, bottom = -0.5, -0.5, width - 0.5, height - 0.5
        corners = np.array([[left, top, 1.0], [right, top, 1.0], [right, bottom, 1.0], [left, bottom, 1.0]])
        rays = np.linalg.solve(self.K, corners.T).T
        outward = np.cross(rays, np.roll(rays, -1, axis=0))
        outward = -outward / np.linalg.norm(outward, axis=1, keepdims=True)
        planes = np.concatenate([outward, [[0.0, 0.0, -1.0]]])
        camera_from_arm = self.arm_from_camera.inverse()
        beyond = [camera_from_arm.apply(points) @ planes.T for points in (starts_m, ends_m)]
        return np.asarray(np.minimum(*beyond).max(axis=-1) - radii_m)


def stow_problems(
    stow_rad: Vector,
    collisions: CollisionModel,
    base_from_arm: Transform,
    views: tuple[CameraView, ...],
    row_side_m: float,
    margin_m: float = 0.02,
) -> tuple[str, ...]:
    """One line for each rule that the stow posture (n,) breaks; empty when it is fit.

    Rules: joint limits; ``margin_m`` to the arm itself, the rover and all that ``collisions`` holds; no point of the
    arm farther out than ``row_side_m`` to either side (base y); ``margin_m`` outside every eye's view.
    """
    posture = np.asarray(stow_rad, dtype=np.float64)
    problems: list[str] = []
    if not within_limits(collisions.model, posture):
        problems.append("stow_rad: expected angles inside the joint limits of the arm's URDF; correct them")
    least_m = float(collisions.clearances(posture[None]).least_m()[0])
    if least_m < margin_m:
        problems.append(f"stow_rad: expected {margin_m:.3f} m of clearance, found {least_m:.3f} m; fold it otherwise")
    starts, ends, radii = collisions.placed_capsules(posture[None])
    ends_m = base_from_arm.apply(np.concatenate([starts[0], ends[0]]))
    out_m = float((np.abs(ends_m[:, 1]) + np.tile(radii, 2)).max())
    if out_m > row_side_m:
        problems.append(
            f"stow_rad: expected the arm within {row_side_m:.3f} m of the lane's middle, found {out_m:.3f} m; "
            "fold it inwards"
        )
    for eye, view in enumerate(views):
        outside_m = float(view.outside_m(starts[0], ends[0], radii).min())
        if outside_m < margin_m:
            problems.append(
                f"stow_rad: expected the arm {margin_m:.3f} m outside the view of eye {eye}, found {outside_m:.3f} m; "
                "fold it lower"
            )
    return tuple(problems)

"""Robot-world and hand-eye calibration in closed form: A_i Z = X B_i for all i, after Park and Martin (1994).

A_i is ``arm_from_tool``, B_i is ``camera_from_board``; wanted are X, ``arm_from_camera``, and Z, ``tool_from_board``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from robot.geometry import Transform

Array = npt.NDArray[np.float64]

_LARGEST_TURN_RAD = np.radians(150.0)  # beyond, the axis of a turn may come out with either sign


@dataclass(frozen=True, slots=True, eq=False)
class Turns:
    """Turns between any two poses as rotation vectors (n, 3), the same ones seen by the arm and by the camera."""

    in_arm: Array
    in_camera: Array

    def spread_rad(self) -> tuple[Array, Array]:
        """Root mean square turn about each principal axis, the largest first (3,), and the axes (3, 3) as rows."""
        _, singular, axes = np.linalg.svd(self.in_arm, full_matrices=False)
        return np.asarray(singular / np.sqrt(len(self.in_arm))), np.asarray(axes)


def turns_between(arm_from_tool: Sequence[Transform], camera_from_board: Sequence[Transform]) -> Turns:
    """All pairs of at least two poses, but for turns so large that their axis is in doubt."""
    first, second = np.triu_indices(len(arm_from_tool), k=1)
    in_arm, in_camera = (
        (stacked[first] * stacked[second].inv()).as_rotvec()
        for stacked in (
            Rotation.from_matrix(np.stack([pose.rotation for pose in poses]))
            for poses in (arm_from_tool, camera_from_board)
        )
    )
    sure = np.linalg.norm(in_arm, axis=1) < _LARGEST_TURN_RAD
    return Turns(in_arm[sure], in_camera[sure])


def closed_form(
    arm_from_tool: Sequence[Transform], camera_from_board: Sequence[Transform], turns: Turns
) -> tuple[Transform, Transform]:
    """``arm_from_camera`` and ``tool_from_board``; the turns must be about two axes at least."""
    camera_turn = _nearest_rotation(turns.in_arm.T @ turns.in_camera)
    tool_turn = _nearest_rotation(
        np.sum(
            [a.rotation.T @ camera_turn @ b.rotation for a, b in zip(arm_from_tool, camera_from_board, strict=True)],
            axis=0,
        )
    )
    design = np.concatenate([np.column_stack([pose.rotation, -np.eye(3)]) for pose in arm_from_tool])
    sides_m = np.concatenate(
        [
            camera_turn @ b.translation_m - a.translation_m
            for a, b in zip(arm_from_tool, camera_from_board, strict=True)
        ]
    )
    shifts_m = np.linalg.lstsq(design, sides_m, rcond=None)[0]
    return Transform(camera_turn, shifts_m[3:]), Transform(tool_turn, shifts_m[:3])


def _nearest_rotation(matrix: Array) -> Array:
    u, _, vt = np.linalg.svd(matrix)
    return np.asarray(u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt)

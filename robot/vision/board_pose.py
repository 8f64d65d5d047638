"""Where the board stands, from its corners in both images of a calibrated pair."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt
from scipy.optimize import least_squares

from robot.geometry import Transform
from robot.vision.board_corners import Board
from robot.vision.camera_calibration import BoardView
from robot.vision.stereo_rig import StereoRig

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class BoardPose:
    """``camera_from_board`` maps the board's frame into the left camera's.

    ``left_rms_px`` and ``right_rms_px`` are distances of the corners from where this pose puts them;
    ``covariance`` (6, 6) of (turn about the camera's axes, radians; translation, metres) for corners as good as those.
    """

    name: str
    camera_from_board: Transform
    left_rms_px: float
    right_rms_px: float
    covariance: Array

    @property
    def rms_px(self) -> float:
        return float(np.sqrt((self.left_rms_px**2 + self.right_rms_px**2) / 2.0))


def estimate_board_pose(view: BoardView, board: Board, rig: StereoRig) -> BoardPose:
    """Least squares on the distances in both images. ``ValueError`` when the corners fit no pose."""
    points_m = board.points_m()
    found, turn, shift_m = cv2.solvePnP(points_m, view.left_px, rig.K_left, rig.dist_left)
    if not found or not (np.isfinite(turn).all() and np.isfinite(shift_m).all()):
        raise ValueError(f"the corners of {view.name} fit no pose of the board; look at the image")
    first = Transform(_rotation(turn), np.asarray(shift_m, dtype=np.float64).ravel())

    def moved(change: Array) -> Transform:
        return Transform(_rotation(change[:3]) @ first.rotation, first.translation_m + change[3:])

    def misses(change: Array) -> Array:
        in_left = moved(change).apply(points_m)
        off = rig.project_left(in_left) - view.left_px, rig.project_right(in_left) - view.right_px
        return np.concatenate(off).ravel()

    fit = least_squares(misses, np.zeros(6), method="lm", x_scale="jac")
    left, right = np.asarray(fit.fun).reshape(2, -1, 2)
    jacobian = np.asarray(fit.jac, dtype=np.float64)
    variance = float(np.sum(fit.fun**2)) / max(len(fit.fun) - 6, 1)
    return BoardPose(
        view.name,
        moved(fit.x),
        float(np.sqrt(np.mean(np.sum(left**2, axis=1)))),
        float(np.sqrt(np.mean(np.sum(right**2, axis=1)))),
        np.asarray(variance * np.linalg.pinv(jacobian.T @ jacobian), dtype=np.float64),
    )


def _rotation(vector: npt.ArrayLike) -> Array:
    return np.asarray(cv2.Rodrigues(np.asarray(vector, dtype=np.float64))[0], dtype=np.float64)

"""The board measured by the rig itself: triangulated corners against what is known of the board."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from robot.vision.board_corners import Board
from robot.vision.camera_calibration import BoardView
from robot.vision.stereo_rig import StereoRig
from robot.vision.triangulation import triangulate

Array = npt.NDArray[np.float64]

_NEAR_IMAGE = 0.1  # of an undistorted pixel's place: no lens moves a point by ten image widths


@dataclass(frozen=True, slots=True)
class BoardScale:
    """One view. ``scale_error`` is the share by which the board is measured too large, at ``distance_m``;
    ``square_rms_m`` the error of a single square's side; ``flatness_rms_m`` how far corners lie off their plane.
    """

    name: str
    distance_m: float
    scale_error: float
    square_rms_m: float
    flatness_rms_m: float


def measure_board(view: BoardView, board: Board, rig: StereoRig) -> BoardScale:
    """Triangulate all corners of a view. ``ValueError`` when rays of a pair do not meet before the camera."""
    left_px, right_px = rig.undistort_left(view.left_px), rig.undistort_right(view.right_px)
    if not all(_NEAR_IMAGE * np.abs(px).max() < max(rig.image_size) for px in (left_px, right_px)):
        raise ValueError(f"the lenses of this calibration bend the corners of {view.name} out of all proportion")
    points_m = triangulate(rig.P_left, rig.P_right, left_px, right_px)
    if not (np.isfinite(points_m).all() and (points_m[:, 2] > 0.0).all()):
        raise ValueError(f"the corners of {view.name} do not lie before the camera; are left and right swapped?")
    centred, true = points_m - points_m.mean(axis=0), board.points_m() - board.points_m().mean(axis=0)
    grid = points_m.reshape(board.rows, board.columns, 3)
    sides_m = np.concatenate([np.linalg.norm(np.diff(grid, axis=axis), axis=2).ravel() for axis in (0, 1)])
    off_plane_m = centred @ np.linalg.svd(centred)[2][2]
    return BoardScale(
        name=view.name,
        distance_m=float(np.linalg.norm(points_m.mean(axis=0))),
        scale_error=_scale(centred, true) - 1.0,
        square_rms_m=float(np.sqrt(np.mean((sides_m - board.square_m) ** 2))),
        flatness_rms_m=float(np.sqrt(np.mean(off_plane_m**2))),
    )


def _scale(measured: Array, true: Array) -> float:
    """Of the similarity that maps the true points onto the measured ones by least squares."""
    u, singular, vt = np.linalg.svd(measured.T @ true)
    signs = np.array([1.0, 1.0, np.sign(np.linalg.det(u) * np.linalg.det(vt))])
    return float(np.sum(singular * signs) / np.sum(true**2))

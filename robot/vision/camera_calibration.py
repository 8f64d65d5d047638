"""Calibration of the stereo pair from board corners, section 3.4.1 of the paper."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
import numpy.typing as npt

from robot.geometry import Transform
from robot.vision.board_corners import Board
from robot.vision.stereo_rig import StereoRig

Array = npt.NDArray[np.float64]
Array32 = npt.NDArray[np.float32]

MIN_VIEWS = 3
_MAX_FOCAL_SIGMA = 0.02  # of the focal length
_STOP = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 100, 1e-9)
_MODEL = cv2.CALIB_FIX_K3  # k1 k2 p1 p2: k3 is not to be had from a board of usual size
_TILT = "take views with the board tilted 20-45 degrees to different sides, near and far, in all parts of the image"


@dataclass(frozen=True, slots=True, eq=False)
class BoardView:
    """The same board in both images of one pair: corners (rows * columns, 2) in stored pixels, in the same order."""

    name: str
    left_px: Array
    right_px: Array


@dataclass(frozen=True, slots=True)
class ViewError:
    """Root mean square reprojection error of one pair, pixels; ``outlier`` by the rule of ``outliers``."""

    name: str
    left_px: float
    right_px: float
    outlier: bool

    @property
    def rms_px(self) -> float:
        return float(np.sqrt((self.left_px**2 + self.right_px**2) / 2.0))


@dataclass(frozen=True, slots=True, eq=False)
class StereoCalibration:
    """A rig with its evidence: root mean square errors in pixels, one-sigma of the focal lengths in pixels."""

    rig: StereoRig
    left_rms_px: float
    right_rms_px: float
    stereo_rms_px: float
    focal_sigma_px: float
    views: tuple[ViewError, ...]


def calibrate_stereo(
    views: Sequence[BoardView], board: Board, image_size: tuple[int, int], world_view: str | None = None
) -> StereoCalibration:
    """Each camera alone, then their pose with fixed intrinsics, then all parameters together.

    ``image_size`` (width, height). With ``world_view`` the board's frame in the view of that name becomes the world.
    Raises ``ValueError`` for too few views, an unknown world view, or views that leave the focal length open.
    """
    if len(views) < MIN_VIEWS:
        raise ValueError(f"at least {MIN_VIEWS} views with the board in both images are needed, found {len(views)}")
    names = [view.name for view in views]
    if world_view is not None and world_view not in names:
        raise ValueError(f"the board was not found in both images of the world view {world_view}")
    corners = _Corners(
        board=[board.points_m().astype(np.float32)] * len(views),
        left=[view.left_px.astype(np.float32).reshape(-1, 1, 2) for view in views],
        right=[view.right_px.astype(np.float32).reshape(-1, 1, 2) for view in views],
        image_size=image_size,
    )
    left = _one_camera("left", corners.board, corners.left, image_size)
    right = _one_camera("right", corners.board, corners.right, image_size)
    alone = StereoRig(image_size, left.K, right.K, left.dist, right.dist, np.eye(3), np.zeros(3))
    posed = _stereo(corners, alone, cv2.CALIB_FIX_INTRINSIC)
    # without CALIB_USE_EXTRINSIC_GUESS: given a guess, OpenCV 5.0 returns another R and t than the one it settled on
    joint = _stereo(corners, posed.rig, cv2.CALIB_USE_INTRINSIC_GUESS)
    rig, errors = joint.rig, joint.view_errors_px
    if world_view is not None:
        rig = replace(rig, world_from_left=joint.board_from_left[names.index(world_view)])
    flags = outliers(np.sqrt(np.mean(errors**2, axis=1)))
    return StereoCalibration(
        rig=rig,
        left_rms_px=left.rms_px,
        right_rms_px=right.rms_px,
        stereo_rms_px=joint.rms_px,
        focal_sigma_px=max(left.focal_sigma_px, right.focal_sigma_px),
        views=tuple(
            ViewError(name, float(pair[0]), float(pair[1]), bool(flag))
            for name, pair, flag in zip(names, errors, flags, strict=True)
        ),
    )


def outliers(rms_px: npt.ArrayLike) -> npt.NDArray[np.bool_]:
    """Views far beyond their fellows: above twice the median and three robust sigmas (1.4826 MAD) over it."""
    errors = np.asarray(rms_px, dtype=np.float64)
    median = float(np.median(errors))
    sigma = 1.4826 * float(np.median(np.abs(errors - median)))
    return np.asarray((errors > 2.0 * median) & (errors > median + 3.0 * sigma))


@dataclass(frozen=True, slots=True, eq=False)
class _Corners:
    board: list[Array32]
    left: list[Array32]
    right: list[Array32]
    image_size: tuple[int, int]


@dataclass(frozen=True, slots=True, eq=False)
class _Camera:
    K: Array
    dist: Array
    rms_px: float
    focal_sigma_px: float


@dataclass(frozen=True, slots=True, eq=False)
class _Stereo:
    rig: StereoRig
    rms_px: float
    view_errors_px: Array  # (views, 2)
    board_from_left: list[Array]  # (4, 4) a view


def _one_camera(side: str, board: list[Array32], corners: list[Array32], image_size: tuple[int, int]) -> _Camera:
    try:
        rms, K, dist, _, _, sigmas, _, _ = cv2.calibrateCameraExtended(
            board, corners, image_size, np.eye(3), np.zeros(5), flags=_MODEL, criteria=_STOP
        )
    except cv2.error as error:
        raise ValueError(f"the {side} camera cannot be calibrated from these views: {_TILT}") from error
    camera = _Camera(_array(K, 3, 3), _array(dist, 5), float(rms), float(_array(sigmas, -1)[:2].max()))
    if not camera.focal_sigma_px <= _MAX_FOCAL_SIGMA * min(camera.K[0, 0], camera.K[1, 1]):
        raise ValueError(f"these views leave the {side} camera's focal length open: {_TILT}")
    return camera


def _stereo(corners: _Corners, start: StereoRig, flags: int) -> _Stereo:
    rms, K_left, dist_left, K_right, dist_right, R, t_m, _, _, turns, shifts_m, errors = cv2.stereoCalibrateExtended(
        corners.board,
        corners.left,
        corners.right,
        start.K_left.copy(),
        start.dist_left.copy(),
        start.K_right.copy(),
        start.dist_right.copy(),
        corners.image_size,
        start.R.copy(),
        start.t_m.copy(),
        flags=flags | _MODEL,
        criteria=_STOP,
    )
    rig = StereoRig(
        image_size=corners.image_size,
        K_left=_array(K_left, 3, 3),
        K_right=_array(K_right, 3, 3),
        dist_left=_array(dist_left, 5),
        dist_right=_array(dist_right, 5),
        R=_array(R, 3, 3),
        t_m=_array(t_m, 3),
    )
    poses = [_board_from_left(_array(turn, 3), _array(shift, 3)) for turn, shift in zip(turns, shifts_m, strict=True)]
    return _Stereo(rig, float(rms), _array(errors, -1, 2), poses)


def _board_from_left(turn: Array, shift_m: Array) -> Array:
    """(4, 4) inverse of the board's pose in the left camera."""
    rotation, _ = cv2.Rodrigues(turn)
    return Transform(_array(rotation, 3, 3), shift_m).inverse().matrix()


def _array(values: npt.ArrayLike, *shape: int) -> Array:
    return np.asarray(values, dtype=np.float64).reshape(shape)

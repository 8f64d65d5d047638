"""Pictures of a 7x5 chessboard, exact corners, for calibrations to look at."""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

from robot.geometry import Transform, rotation_from_rpy
from robot.vision.board_corners import Board
from robot.vision.stereo_rig import StereoRig

Array = npt.NDArray[np.float64]
Image = npt.NDArray[np.uint8]

UNIT = 40.0  # the side of a square in the board plane of ``board_picture``


def board_picture(homography: Array, size: tuple[int, int] = (640, 480)) -> Image:
    """The board plane (first inner corner at 0, 0; ``UNIT`` a square) under a homography, four times oversampled."""
    squares = np.indices((6, 8)).sum(axis=0) % 2
    sheet = np.kron(np.where(squares == 0, 30, 220), np.ones((160, 160))).astype(np.uint8)
    sheet = np.asarray(cv2.copyMakeBorder(sheet, 160, 160, 160, 160, cv2.BORDER_CONSTANT, value=220), dtype=np.uint8)
    to_board = np.array([[0.25, 0.0, 0.125 - 80.0], [0.0, 0.25, 0.125 - 80.0], [0.0, 0.0, 1.0]])
    oversample = np.array([[4.0, 0.0, 1.5], [0.0, 4.0, 1.5], [0.0, 0.0, 1.0]])
    large = (size[0] * 4, size[1] * 4)
    to_picture = oversample @ homography @ to_board
    picture = cv2.warpPerspective(sheet, to_picture, large, flags=cv2.INTER_AREA, borderValue=150)
    return np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)


def board_pair(index: int, rig: StereoRig, square_m: float) -> tuple[Image, Image]:
    """The board in the index-th of some poses, as a rig without distortion sees it."""
    rng = np.random.default_rng(500 + index)
    turn = rotation_from_rpy(rng.uniform(-0.5, 0.5), rng.uniform(-0.5, 0.5), rng.uniform(-0.2, 0.2))
    middle_m = np.array([rng.uniform(-0.02, 0.08), rng.uniform(-0.04, 0.04), rng.uniform(0.40, 0.55)])
    origin_m = middle_m - turn @ np.array([3.0, 2.0, 0.0]) * square_m
    left_from_plane = np.column_stack([turn[:, 0] * square_m / UNIT, turn[:, 1] * square_m / UNIT, origin_m])
    right_from_plane = rig.R @ left_from_plane
    right_from_plane[:, 2] += rig.t_m
    return (
        board_picture(rig.K_left @ left_from_plane, rig.image_size),
        board_picture(rig.K_right @ right_from_plane, rig.image_size),
    )


def board_photo(
    rig: StereoRig,
    side: str,
    board: Board,
    camera_from_board: Transform,
    blur_px: float = 0.7,
    noise: float = 1.5,
    seed: int = 0,
    margin: float = 1.0,
) -> Image:
    """The board as one distorted lens of the rig sees it: four rays a pixel's side, blurred, with noise of ``noise``
    codes. The outer squares are ``margin`` of a square wide; white card around them, grey behind.
    """
    rays = _fine_rays(rig, side)
    if side == "right":
        camera_from_board = Transform(rig.R, rig.t_m) @ camera_from_board
    board_from_camera = camera_from_board.inverse()
    direction, origin_m = board_from_camera.rotate(rays), board_from_camera.translation_m
    on_plane = (origin_m - direction * (origin_m[2] / direction[:, 2])[:, None])[:, :2] / board.square_m
    odd = np.floor(on_plane).astype(int).sum(axis=1) % 2 != 0
    beyond = np.maximum(-on_plane, on_plane - [board.columns - 1, board.rows - 1]).max(axis=1)
    codes = np.where(beyond < margin, np.where(odd, 35.0, 215.0), np.where(beyond < margin + 0.7, 215.0, 110.0))
    width, height = rig.image_size
    picture = codes.reshape(height, _FINE, width, _FINE).mean(axis=(1, 3))
    picture = cv2.GaussianBlur(picture, (0, 0), blur_px)
    picture += np.random.default_rng([seed, side == "right"]).normal(0.0, noise, picture.shape)
    return np.clip(np.round(picture), 0, 255).astype(np.uint8)


_FINE = 4
_RAYS: dict[tuple[int, str], tuple[StereoRig, Array]] = {}


def _fine_rays(rig: StereoRig, side: str) -> Array:
    """Rays (n, 3) of a lens, ``_FINE`` by ``_FINE`` a pixel. Worked out once for each rig object."""
    if (id(rig), side) not in _RAYS:
        width, height = rig.image_size
        y, x = np.mgrid[: height * _FINE, : width * _FINE]
        stored = (np.column_stack([x.ravel(), y.ravel()]) + 0.5) / _FINE - 0.5
        K, undistort = (rig.K_left, rig.undistort_left) if side == "left" else (rig.K_right, rig.undistort_right)
        rays = np.column_stack([undistort(stored), np.ones(len(stored))]) @ np.linalg.inv(K).T
        _RAYS[id(rig), side] = rig, rays
    return _RAYS[id(rig), side][1]

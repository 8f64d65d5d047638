"""Pictures of a 7x5 chessboard, exact corners, for calibrations to look at."""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

from robot.geometry import rotation_from_rpy
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

"""The inner corners of a chessboard in an image, to a tenth of a pixel."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from robot.vision.corner_fit import CornerFit, fit_corners

Array = npt.NDArray[np.float64]
GreyImage = npt.NDArray[np.uint8]

MOST_SIGMA_PX = 0.1  # root mean square over a view's corners
_MOST_FAILED = 0.1  # of the corners
_WINDOW_PER_SPACING = 0.33  # the search window must see one corner and as much of its edges as fits
_SUBPIXEL_STOP = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 50, 1e-4)


@dataclass(frozen=True, slots=True)
class Board:
    """A chessboard of ``columns`` x ``rows`` inner corners, ``square_m`` metres apart."""

    columns: int
    rows: int
    square_m: float

    def __post_init__(self) -> None:
        if min(self.columns, self.rows) < 3 or self.columns == self.rows:
            raise ValueError(
                f"a board needs at least 3x3 inner corners and different counts, found {self.columns}x{self.rows}"
            )
        if not 0.001 <= self.square_m <= 1.0:
            raise ValueError(f"a board's square must be 0.001..1 m, found {self.square_m}")

    def points_m(self) -> Array:
        """Corners (rows * columns, 3) in the board's frame: x along a row, y from row to row, z into the board."""
        v, u = np.mgrid[: self.rows, : self.columns]
        return np.column_stack([u.ravel(), v.ravel(), np.zeros(u.size)]) * self.square_m


def find_corners(image: GreyImage, board: Board) -> Array | None:
    """Corners (rows * columns, 2) in pixels, row by row, or None when the board is not wholly seen.

    A board that looks the same after half a turn (columns + rows even) starts at its end nearer to the top left.
    """
    fit = measure_corners(image, board)
    return None if fit is None else fit.points_px


def measure_corners(image: GreyImage, board: Board) -> CornerFit | None:
    """As ``find_corners``, with how sure each corner is."""
    found, coarse = cv2.findChessboardCorners(image, (board.columns, board.rows))
    if not found:
        return None
    grid = np.asarray(coarse, dtype=np.float64).reshape(board.rows, board.columns, 2)
    half_window = max(2, int(_WINDOW_PER_SPACING * _smallest_spacing_px(grid)))
    fine = cv2.cornerSubPix(image, coarse, (half_window, half_window), (-1, -1), _SUBPIXEL_STOP)
    start = np.asarray(fine, dtype=np.float64).reshape(-1, 2)
    fit = fit_corners(image, start, board.rows, board.columns)
    looks_same_turned = (board.columns + board.rows) % 2 == 0
    if looks_same_turned and fit.points_px[0].sum() > fit.points_px[-1].sum():
        return CornerFit(fit.points_px[::-1].copy(), fit.sigma_px[::-1].copy(), fit.blur_px[::-1].copy())
    return fit


def unfit_for_calibration(fit: CornerFit) -> str | None:
    """Why corners are not good enough to calibrate with, and what to do; None when they are."""
    failed = int(np.count_nonzero(~np.isfinite(fit.sigma_px)))
    if failed > _MOST_FAILED * len(fit.sigma_px):
        return (
            f"{failed} of {len(fit.sigma_px)} corners are not two straight edges that cross; keep glare, fingers and "
            "shadows off the board, and do not tilt it beyond 60 degrees"
        )
    sigma_px = float(np.sqrt(np.mean(fit.sigma_px[np.isfinite(fit.sigma_px)] ** 2)))
    if sigma_px > MOST_SIGMA_PX:
        return (
            f"corners are sure to {sigma_px:.2f} px only, {MOST_SIGMA_PX:g} px are needed (blur "
            f"{float(np.median(fit.blur_px)):.1f} px); hold the board still, nearer, in more light"
        )
    return None


def same_order(left: Array, right: Array) -> Array:
    """The right view's corners in the left view's order (the two may start at opposite ends of the board)."""
    turned = float((left[-1] - left[0]) @ (right[-1] - right[0])) < 0.0
    return right[::-1].copy() if turned else right


def _smallest_spacing_px(grid: Array) -> float:
    return float(min(np.linalg.norm(np.diff(grid, axis=axis), axis=2).min() for axis in (0, 1)))

"""What the views of a board have shown so far, and what to show next."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import TypeVar

import cv2
import numpy as np
import numpy.typing as npt

from robot.vision.board_corners import Board
from robot.vision.camera_calibration import BoardView

Array = npt.NDArray[np.float64]
Cells = npt.NDArray[np.bool_]

GRID = 6  # cells along either side of an image; a region of three by three has two by two of them
WORKING_RANGE_M = (0.3, 0.9)
VIEWS_A_POSTURE = 2  # of each tilt and each distance
_CELLS_A_REGION = 3  # of its four
_CORNERS_A_CELL = 2
_FACING_DEG, _TILTED_DEG = 12.0, 15.0
_TYPICAL_FOCAL = 0.8  # of the image's width, as long as nothing better is known
_ACROSS, _DOWN = ("left", "middle", "right"), ("upper", "middle", "lower")


class Tilt(StrEnum):
    """How the board stands towards the camera. The words are for the person who holds it."""

    FACING = "facing the camera"
    LEFT_NEARER = "its left edge nearer"
    RIGHT_NEARER = "its right edge nearer"
    UPPER_NEARER = "its upper edge nearer"
    LOWER_NEARER = "its lower edge nearer"


class Distance(StrEnum):
    """Thirds of the working range."""

    NEAR = "near"
    MIDDLE = "at middle distance"
    FAR = "far"


_Kind = TypeVar("_Kind", bound=StrEnum)


@dataclass(frozen=True, slots=True, eq=False)
class Coverage:
    """``left_cells`` and ``right_cells`` (GRID, GRID), rows from the top: where corners have been seen.

    ``tilts`` and ``distances`` count views. ``missing_*`` is what has not been shown enough, the worst first.
    ``advice`` says how to hold the board next; None when all is covered.
    """

    left_cells: Cells
    right_cells: Cells
    tilts: dict[Tilt, int]
    distances: dict[Distance, int]
    missing_regions: tuple[str, ...]
    missing_tilts: tuple[Tilt, ...]
    missing_distances: tuple[Distance, ...]
    advice: str | None

    @property
    def complete(self) -> bool:
        return self.advice is None

    @property
    def cell_share(self) -> float:
        """Of the cells of both images."""
        return float(np.mean([self.left_cells, self.right_cells]))


def coverage(
    views: Sequence[BoardView], board: Board, image_size: tuple[int, int], focal_px: float | None = None,
    working_range_m: tuple[float, float] = WORKING_RANGE_M,
) -> Coverage:  # fmt: skip
    """Judge views of a board; ``image_size`` (width, height). Before a calibration ``focal_px`` is a guess."""
    focal_px = _TYPICAL_FOCAL * image_size[0] if focal_px is None else focal_px
    postures = [_posture(view, board, image_size, focal_px, working_range_m) for view in views]
    tilts = Counter(tilt for tilt, _ in postures if tilt is not None)
    distances = Counter(distance for _, distance in postures)
    left, right = (_cells(corners, image_size) for corners in ([v.left_px for v in views], [v.right_px for v in views]))
    regions = _missing_regions(left, right)
    missing_tilts = _rare(tilts, tuple(Tilt))
    missing_distances = _rare(distances, tuple(Distance))
    return Coverage(
        left, right, {tilt: tilts[tilt] for tilt in Tilt}, {far: distances[far] for far in Distance},
        regions, missing_tilts, missing_distances,
        _advice(regions, missing_tilts, missing_distances, working_range_m),
    )  # fmt: skip


def distance_bounds_m(
    distance: Distance, working_range_m: tuple[float, float] = WORKING_RANGE_M
) -> tuple[float, float]:
    """Thirds of the range by ratio: what is far has to be seen from farther apart."""
    low_m, high_m = working_range_m
    third = (high_m / low_m) ** (1.0 / 3.0)
    index = tuple(Distance).index(distance)
    return low_m * third**index, low_m * third ** (index + 1)


def _posture(
    view: BoardView, board: Board, image_size: tuple[int, int], focal_px: float, working_range_m: tuple[float, float]
) -> tuple[Tilt | None, Distance]:
    K = np.array([[focal_px, 0.0, image_size[0] / 2.0], [0.0, focal_px, image_size[1] / 2.0], [0.0, 0.0, 1.0]])
    points_m = board.points_m() - board.points_m().mean(axis=0)
    _, turn, shift_m = cv2.solvePnP(points_m, view.left_px, K, np.zeros(5))
    normal = np.asarray(cv2.Rodrigues(turn)[0], dtype=np.float64)[:, 2]
    line_of_sight = np.asarray(shift_m, dtype=np.float64).ravel()
    distance_m = float(np.linalg.norm(line_of_sight))
    normal = normal * np.sign(normal @ line_of_sight)  # away from the camera
    edges = [distance_bounds_m(distance, working_range_m)[1] for distance in tuple(Distance)[:-1]]
    return _tilt(normal), tuple(Distance)[int(np.searchsorted(edges, distance_m))]


def _tilt(normal: Array) -> Tilt | None:
    """By the normal that points away from the camera; None between facing and tilted."""
    about_vertical, about_horizontal = (float(np.degrees(np.arctan2(normal[axis], normal[2]))) for axis in (0, 1))
    most = max(abs(about_vertical), abs(about_horizontal))
    if most < _FACING_DEG:
        return Tilt.FACING
    if most < _TILTED_DEG:
        return None
    if abs(about_vertical) >= abs(about_horizontal):
        return Tilt.RIGHT_NEARER if about_vertical > 0.0 else Tilt.LEFT_NEARER
    return Tilt.LOWER_NEARER if about_horizontal > 0.0 else Tilt.UPPER_NEARER


def _cells(corners: Sequence[Array], image_size: tuple[int, int]) -> Cells:
    counts = np.zeros((GRID, GRID), dtype=int)
    for points in corners:
        place = np.clip((points * GRID / np.array(image_size)).astype(int), 0, GRID - 1)
        np.add.at(counts, (place[:, 1], place[:, 0]), 1)
    return np.asarray(counts >= _CORNERS_A_CELL)


def _missing_regions(left: Cells, right: Cells) -> tuple[str, ...]:
    """Names of the ninths of the image in which either camera has seen too little, the emptiest first."""
    found: list[tuple[int, str]] = []
    for row in range(3):
        for column in range(3):
            part = np.s_[2 * row : 2 * row + 2, 2 * column : 2 * column + 2]
            least = min(int(left[part].sum()), int(right[part].sum()))
            if least < _CELLS_A_REGION:
                found.append((least, _region_name(row, column)))
    return tuple(name for _, name in sorted(found, key=lambda item: item[0]))


def _region_name(row: int, column: int) -> str:
    if row == column == 1:
        return "middle"
    return f"{_DOWN[row]} {_ACROSS[column]}"


def _rare(seen: Mapping[_Kind, int], kinds: tuple[_Kind, ...]) -> tuple[_Kind, ...]:
    return tuple(sorted((kind for kind in kinds if seen[kind] < VIEWS_A_POSTURE), key=lambda kind: seen[kind]))


def _advice(
    regions: Sequence[str], tilts: Sequence[Tilt], distances: Sequence[Distance], working_range_m: tuple[float, float]
) -> str | None:
    if not (regions or tilts or distances):
        return None
    parts = [f"in the {regions[0]} of the image, as far out as both lenses see it whole"] if regions else []
    if tilts:
        parts.append(str(tilts[0]) if tilts[0] is Tilt.FACING else f"tilted 20 to 45 degrees with {tilts[0]}")
    if distances:
        low_m, high_m = distance_bounds_m(distances[0], working_range_m)
        parts.append(f"{distances[0]} ({low_m:.2f} to {high_m:.2f} m)")
    return f"hold the board {', '.join(parts)}"

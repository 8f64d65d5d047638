"""The centre from three points of the contour, steps I to VI of section 3.3.3."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from robot.vision.paper.parameters import PaperParameters
from robot.vision.paper.regions import Region

Point = npt.NDArray[np.float64]
Contour = npt.NDArray[np.int64]


def circle_of(region: Region, parameters: PaperParameters) -> tuple[float, float, float] | None:
    """(u, v, r) in pixels from three contour points, or None when no three points can be had.

    Step I takes the contour's points in the order of a raster scan as A; M and N follow the region's size and shrink
    with each of the retries.
    """
    size_px = math.sqrt(region.area_px / math.pi)
    scan = region.contour[np.lexsort((region.contour[:, 0], region.contour[:, 1]))]
    for first in scan[: parameters.retries + 1]:
        for attempt in range(parameters.retries + 1):
            shrink = 1.0 - attempt / (parameters.retries + 1)
            second = second_point(region.contour, first, round(parameters.horizontal_skip * size_px * shrink))
            if second is None:
                continue
            third = third_point(region.contour, first, round(parameters.vertical_skip * size_px * shrink))
            if third is None:
                continue
            centre = circumcentre(first, second, third)
            if centre is not None:
                return float(centre[0]), float(centre[1]), float(np.linalg.norm(first - centre))  # r = |A O|
    return None


def second_point(contour: Contour, first: Contour, skip_px: int) -> Contour | None:
    """Step II: B, the contour's point in the column ``skip_px`` to the right of A that lies nearest to A's row."""
    column = contour[contour[:, 0] == first[0] + skip_px]
    if skip_px < 1 or len(column) == 0:
        return None
    return np.asarray(column[np.argmin(np.abs(column[:, 1] - first[1]))])


def third_point(contour: Contour, first: Contour, skip_px: int) -> Contour | None:
    """Step III: C, the first point of the contour met leftwards from A's column in the row ``skip_px`` below A."""
    row = contour[(contour[:, 1] == first[1] + skip_px) & (contour[:, 0] < first[0])]
    if skip_px < 1 or len(row) == 0:
        return None
    return np.asarray(row[np.argmax(row[:, 0])])


def circumcentre(a: npt.ArrayLike, b: npt.ArrayLike, c: npt.ArrayLike) -> Point | None:
    """Steps IV and V: where the perpendicular bisectors f1 of AB and f2 of AC cross; None when they are parallel."""
    first = np.asarray(a, dtype=np.float64)
    chords = np.array([np.asarray(b, dtype=np.float64) - first, np.asarray(c, dtype=np.float64) - first])
    lengths_squared = np.sum(chords**2, axis=1)
    if abs(np.linalg.det(chords)) <= 1e-9 * float(np.prod(np.sqrt(lengths_squared))) or not lengths_squared.all():
        return None
    return np.asarray(first + np.linalg.solve(chords, lengths_squared / 2.0))

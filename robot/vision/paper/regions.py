"""Closed regions and their circularity, section 3.3.3."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from robot.vision.paper.parameters import PaperParameters

Image = npt.NDArray[np.uint8]


@dataclass(frozen=True, slots=True, eq=False)
class Region:
    """A region that edge pixels enclose: ``contour`` (n, 2) of integer (u, v), in order, on those edge pixels."""

    contour: npt.NDArray[np.int64]
    area_px: float
    circularity: float


def circularity(area: float, perimeter: float) -> float:
    """Eq. 3: e = 4 pi S / L^2, 1 for a disc and less for any other shape."""
    return 4.0 * math.pi * area / perimeter**2 if perimeter > 0.0 else 0.0


def round_regions(edges: Image, parameters: PaperParameters) -> list[Region]:
    """Regions of admitted area and circularity that the edge pixels (non-zero) close off from the image's border."""
    height, width = edges.shape
    open_space = cv2.bitwise_not(edges)
    _, labels, stats, _ = cv2.connectedComponentsWithStats(open_space, connectivity=4)
    lowest, highest = parameters.min_area * edges.size, parameters.max_area * edges.size
    left, top = stats[:, cv2.CC_STAT_LEFT], stats[:, cv2.CC_STAT_TOP]
    right, bottom = left + stats[:, cv2.CC_STAT_WIDTH], top + stats[:, cv2.CC_STAT_HEIGHT]
    area = stats[:, cv2.CC_STAT_AREA]
    closed = (left > 0) & (top > 0) & (right < width) & (bottom < height) & (area >= lowest) & (area <= highest)
    closed[0] = False  # label 0 is the edge pixels themselves
    found = []
    for label in np.flatnonzero(closed):
        window = labels[top[label] - 1 : bottom[label] + 1, left[label] - 1 : right[label] + 1]
        region = _region((window == label).astype(np.uint8), int(left[label]) - 1, int(top[label]) - 1)
        if region.circularity >= parameters.min_circularity and lowest <= region.area_px <= highest:
            found.append(region)
    return found


def _region(inside: Image, left_px: int, top_px: int) -> Region:
    with_edge = cv2.dilate(inside, np.ones((3, 3), np.uint8))
    contours, _ = cv2.findContours(with_edge, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE, offset=(left_px, top_px))
    contour = contours[0]
    area = float(cv2.contourArea(contour))
    return Region(contour.reshape(-1, 2).astype(np.int64), area, circularity(area, float(cv2.arcLength(contour, True))))

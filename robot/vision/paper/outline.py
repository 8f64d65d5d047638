"""Outlines by the Laplacian, section 3.3.2."""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

from robot.vision.paper.excess_green import excess_green
from robot.vision.paper.parameters import PaperParameters

Image = npt.NDArray[np.uint8]

_FOUR = np.array([[0.0, 1.0, 0.0], [1.0, -4.0, 1.0], [0.0, 1.0, 0.0]])
_EIGHT = np.array([[1.0, 1.0, 1.0], [1.0, -8.0, 1.0], [1.0, 1.0, 1.0]])


def laplacian(grey: Image, neighbours: int) -> npt.NDArray[np.int16]:
    """Eq. 2 on the grid: the sum over the 4 or 8 neighbours less as many times the pixel itself."""
    kernel = _EIGHT if neighbours == 8 else _FOUR
    return np.asarray(cv2.filter2D(grey, cv2.CV_16S, kernel, borderType=cv2.BORDER_REPLICATE), dtype=np.int16)


def outlines(image: Image, parameters: PaperParameters) -> Image:
    """Edge pixels (255) of a (height, width, 3) BGR image, after eq. 1 and eq. 2: (height, width)."""
    green = excess_green(image, parameters.green_weight)
    if parameters.reading == "laplacian":
        second, threshold = laplacian(green, parameters.neighbours), parameters.edge_threshold
    else:
        binary = cv2.threshold(green, parameters.binary_threshold, 255, cv2.THRESH_BINARY)[1]
        smooth = cv2.medianBlur(binary, parameters.median_px) if parameters.median_px > 1 else binary
        second, threshold = laplacian(np.asarray(smooth, dtype=np.uint8), parameters.neighbours), 0
    return np.where(np.abs(second) > threshold, np.uint8(255), np.uint8(0))

"""Excess green, section 3.3.1."""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

Image = npt.NDArray[np.uint8]


def excess_green(image: Image, green_weight: float) -> Image:
    """Eq. 1 of a (height, width, 3) BGR image: (height, width).

    0 where 2G < R + B, else ``green_weight`` G - R - B cut off at 255.
    """
    weighted = cv2.transform(image, np.array([[-1.0, green_weight, -1.0]]))
    lack_of_green = cv2.transform(image, np.array([[1.0, -2.0, 1.0]]))
    _, green = cv2.threshold(lack_of_green, 0, 255, cv2.THRESH_BINARY_INV)
    return np.asarray(cv2.bitwise_and(weighted, green), dtype=np.uint8)

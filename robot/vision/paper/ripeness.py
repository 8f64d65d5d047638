"""Ripeness from the mean colour inside a circle. (The paper has no ripeness: this is the plainest measure.)"""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

from robot.vision.values import Ripeness

Image = npt.NDArray[np.uint8]

_GREEN_RATIO, _RED_RATIO = -0.1, 0.5  # (R - G) / (R + G) of a full green and a full red fruit
_TURNING_FROM, _RED_FROM = 0.25, 0.75


def ripeness_score(image: Image, circle: tuple[float, float, float]) -> float:
    """0 (green) to 1 (red) by the mean of (R - G) / (R + G) inside the inner three quarters of a circle (u, v, r)."""
    u, v, r = circle
    height, width = image.shape[:2]
    reach = max(1.0, 0.75 * r)
    left, right = max(0, round(u - reach)), min(width, round(u + reach) + 1)
    top, bottom = max(0, round(v - reach)), min(height, round(v + reach) + 1)
    if left >= right or top >= bottom:
        return 0.0
    rows, columns = np.ogrid[top:bottom, left:right]
    inside = ((columns - u) ** 2 + (rows - v) ** 2 <= reach**2).astype(np.uint8)
    _, green, red, _ = cv2.mean(image[top:bottom, left:right], inside)
    if red + green <= 0.0:
        return 0.0
    ratio = (red - green) / (red + green)
    return float(np.clip((ratio - _GREEN_RATIO) / (_RED_RATIO - _GREEN_RATIO), 0.0, 1.0))


def ripeness_of(score: float) -> Ripeness:
    if score >= _RED_FROM:
        return Ripeness.RED
    return Ripeness.TURNING if score >= _TURNING_FROM else Ripeness.GREEN

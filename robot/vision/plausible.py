"""Whether what a detector gives can be: a frame in which anything cannot is worth nothing."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from robot.vision.values import Circle, Fruit

MOST_FRUITS = 500
FARTHEST_M = 20.0
DIAMETER_M = 0.002, 0.5
LARGEST_CIRCLE = 0.5  # its radius, as a share of the image's longer side


def implausible(fruits: Sequence[Fruit], image_size: tuple[int, int]) -> str:
    """Why these fruits of a pair of (width, height) images cannot be; "" when they can."""
    if len(fruits) > MOST_FRUITS:
        return f"{len(fruits)} fruits (at most {MOST_FRUITS} are believed)"
    for number, fruit in enumerate(fruits, start=1):
        for what, holds in _checks(fruit, image_size):
            if not holds:
                return f"fruit {number} of {len(fruits)} with {what}"
    return ""


def _checks(fruit: Fruit, image_size: tuple[int, int]) -> tuple[tuple[str, bool], ...]:
    centre, covariance = np.asarray(fruit.centre_m), np.asarray(fruit.covariance_m2)
    shares = (fruit.confidence, fruit.visible_fraction, fruit.ripeness_score)
    finite = centre.shape == (3,) and bool(np.isfinite(centre).all())
    spread = covariance.shape == (3, 3) and bool(np.isfinite(covariance).all())
    return (
        (f"the centre {centre} m", finite and centre[2] > 0.0 and float(np.abs(centre).max()) <= FARTHEST_M),
        ("a covariance that is none", spread and bool((np.diag(covariance) >= 0.0).all())),
        (f"a diameter of {fruit.diameter_m} m", DIAMETER_M[0] <= fruit.diameter_m <= DIAMETER_M[1]),
        (f"a diameter's error of {fruit.diameter_sigma_m} m", 0.0 <= fruit.diameter_sigma_m < math.inf),
        (f"shares {shares}", all(0.0 <= share <= 1.0 for share in shares)),
        (f"the outline {fruit.left}", _fits(fruit.left, image_size)),
        (f"the outline {fruit.right}", _fits(fruit.right, image_size)),
    )


def _fits(circle: Circle, image_size: tuple[int, int]) -> bool:
    """An outline may reach over the image's edge, and its centre may lie beyond it by as much."""
    (width, height), r_px = image_size, circle.r_px
    if not 0.0 < r_px <= LARGEST_CIRCLE * max(image_size):
        return False
    return -r_px <= circle.u_px <= width + r_px and -r_px <= circle.v_px <= height + r_px

"""When two spheroids touch: the contact function of Perram and Wertheim (J. Comput. Phys. 58, 1985)."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
from scipy.optimize import minimize_scalar

Array = npt.NDArray[np.float64]


def touching_distance(shape_a: Array, shape_b: Array, direction: Array) -> float:
    """Distance of the centres at which two ellipsoids touch, along the unit ``direction`` (3,) from b to a.

    ``shape_*`` (3, 3) is E of (x - c)' E (x - c) = 1, in 1/m2.
    """
    wide_a, wide_b = np.linalg.inv(shape_a), np.linalg.inv(shape_b)

    def contact(share: float) -> float:
        mixed = (1.0 - share) * wide_a + share * wide_b
        return -share * (1.0 - share) * float(direction @ np.linalg.solve(mixed, direction))

    best = minimize_scalar(contact, bounds=(0.0, 1.0), method="bounded", options={"xatol": 1e-8})
    return 1.0 / math.sqrt(-float(best.fun))


def overlaps(shape_a: Array, shape_b: Array, offset_m: Array, gap_m: float = 0.0) -> bool:
    """Whether two ellipsoids whose centres lie ``offset_m`` (3,) apart come nearer than ``gap_m`` along that line."""
    distance = float(np.linalg.norm(offset_m))
    if distance == 0.0:
        return True
    return distance < touching_distance(shape_a, shape_b, offset_m / distance) + gap_m

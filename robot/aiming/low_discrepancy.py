"""Evenly spread points, the same at every call: sampling without a random generator."""

from __future__ import annotations

import numpy as np

from robot.geometry import Vector


def spread_between(lower: Vector, upper: Vector, count: int) -> Vector:
    """``count`` points in the box from ``lower`` (n,) to ``upper`` (n,): (count, n).

    Additive recurrence with the powers of the inverse generalised golden ratio, the root of x^(n+1) = x + 1.
    """
    dimensions = lower.size
    ratio = 2.0
    for _ in range(60):
        ratio = (1.0 + ratio) ** (1.0 / (dimensions + 1))
    steps = (1.0 / ratio) ** np.arange(1, dimensions + 1)
    share = np.mod(0.5 + np.arange(1, count + 1)[:, None] * steps, 1.0)
    return np.asarray(lower + share * (upper - lower))

"""The calyx on a tomato's top."""

from __future__ import annotations

import math

import cv2
import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float32]

CALYX_BGR = (0.022, 0.115, 0.035)
_SIZE_PX = 64
_KINDS = 16
_SEED = 733


class CalyxAtlas:
    """Where sepals lie, seen along the fruit's axis over -1..1 equatorial radii; a fruit has the star of its index."""

    def __init__(self) -> None:
        self._pictures: Floats = np.vstack([_star(np.random.default_rng([_SEED, k])) for k in range(_KINDS)])

    def over(self, chosen: npt.NDArray[np.int64], place: Floats) -> Floats:
        """(m, p) share of calyx at places (m, 3, p) in equatorial radii along the axis and across it; none below."""
        half, middle = np.float32(0.5 * _SIZE_PX), np.float32(0.5 * _SIZE_PX - 0.5)
        maps = np.clip(place[:, 1:] * half + middle, 0.0, _SIZE_PX - 1.0)
        v = maps[:, 1] + (chosen % _KINDS * _SIZE_PX).astype(np.float32)[:, None]
        star = cv2.remap(self._pictures, np.ascontiguousarray(maps[:, 0]), v, cv2.INTER_LINEAR)
        return np.asarray(star * (place[:, 0] > 0.0), dtype=np.float32)


def _star(rng: np.random.Generator) -> Floats:
    drawn = 4 * _SIZE_PX
    star = np.zeros((drawn, drawn), np.uint8)
    turn = rng.uniform(0.0, math.tau)
    for k in range(5):
        bearing = turn + k * math.tau / 5 + rng.normal(0.0, 0.12)
        length, width = rng.uniform(0.5, 0.78), rng.uniform(0.10, 0.15)
        s = np.linspace(0.0, 1.0, 12)
        half = width * np.sin(np.pi * (0.15 + 0.85 * s)) ** 0.7
        bend = rng.normal(0.0, 0.12) * s**2
        sides = np.vstack(
            [np.column_stack([length * s, bend + half]), np.column_stack([length * s, bend - half])[::-1]]
        )
        c, d = math.cos(bearing), math.sin(bearing)
        points = (sides @ np.array([[c, d], [-d, c]]) * 0.5 + 0.5) * drawn
        cv2.fillPoly(star, [np.round(points * 256.0).astype(np.int32)], 255, cv2.LINE_AA, 8)
    small = cv2.resize(star, (_SIZE_PX, _SIZE_PX), interpolation=cv2.INTER_AREA)
    return np.asarray(small.astype(np.float32) / np.float32(255.0))

"""One report a fruit: of hypotheses whose discs share their middle only the best stays."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


BEHIND_SHARE = 0.8
"""Centres nearer than this share of the larger half-angle: so far behind, a fruit shows less than half of itself."""
SOLID_SHARE = 0.7
"""Two fruit cannot stand in each other: centres are apart by the sum of the radii, less what the depth may be off."""
PIECE_CHANCE, PIECE_SHARE = 0.3, 0.97


def keep_best(centre_m: Array, radius_m: Array, rank: Array, measured_well: Array) -> npt.NDArray[np.int64]:
    """Indices kept, best first, of hypotheses ``centre_m`` (n, 3), the eye at the origin, and ``radius_m`` (n,).

    A hypothesis goes when a better one is nested with it in the image or stands in the same place in space, and when
    it cuts a better one's outline in the image without being measured well (n,): a piece of a fruit behind a leaf.
    """
    distance = np.linalg.norm(centre_m, axis=1)
    direction = centre_m / distance[:, None]
    half_angle = np.arcsin(np.clip(radius_m / distance, 0.0, 1.0))
    kept: list[int] = []
    for k in np.argsort(-rank, kind="stable"):
        apart = np.arccos(np.clip(direction[kept] @ direction[k], -1.0, 1.0))
        nested = apart < BEHIND_SHARE * np.maximum(half_angle[kept], half_angle[k])
        gap_m = np.linalg.norm(centre_m[kept] - centre_m[k], axis=1)
        solid = gap_m < SOLID_SHARE * (radius_m[kept] + radius_m[k])
        piece = (measured_well[k] < PIECE_CHANCE) & (apart < PIECE_SHARE * (half_angle[kept] + half_angle[k]))
        if not (nested | solid | piece).any():
            kept.append(int(k))
    return np.array(kept, dtype=np.int64)


def keep_best_circles(circles: Array, rank: Array) -> npt.NDArray[np.int64]:
    """The same in one image, without space: (n, 3) circles of u, v, r."""
    kept: list[int] = []
    for k in np.argsort(-rank, kind="stable"):
        apart = np.hypot(*(circles[kept, :2] - circles[k, :2]).T)
        if not (apart < BEHIND_SHARE * np.maximum(circles[kept, 2], circles[k, 2])).any():
            kept.append(int(k))
    return np.array(kept, dtype=np.int64)

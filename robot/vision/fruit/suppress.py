"""One report a fruit: of hypotheses whose discs share their middle only the best stays."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


def keep_best(directions: Array, half_angle_rad: Array, rank: Array, share: float = 0.8) -> npt.NDArray[np.int64]:
    """Indices kept, best first.

    ``directions`` (n, 3) unit vectors to the centres, ``half_angle_rad`` (n,) of the outlines. A hypothesis goes when
    its centre is nearer to a better one than ``share`` of the larger half-angle: a fruit so far behind another would
    show less than half of itself, and a nested circle is the same fruit.
    """
    kept: list[int] = []
    for k in np.argsort(-rank, kind="stable"):
        cosine = directions[kept] @ directions[k]
        apart = np.arccos(np.clip(cosine, -1.0, 1.0))
        if not (apart < share * np.maximum(half_angle_rad[kept], half_angle_rad[k])).any():
            kept.append(int(k))
    return np.array(kept, dtype=np.int64)


def keep_best_circles(circles: Array, rank: Array, share: float = 0.8) -> npt.NDArray[np.int64]:
    """The same in one image: (n, 3) circles of u, v, r."""
    kept: list[int] = []
    for k in np.argsort(-rank, kind="stable"):
        apart = np.hypot(*(circles[kept, :2] - circles[k, :2]).T)
        if not (apart < share * np.maximum(circles[kept, 2], circles[k, 2])).any():
            kept.append(int(k))
    return np.array(kept, dtype=np.int64)

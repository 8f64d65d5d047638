"""One eye's picture while it is painted: colour, nearest inverse depth and which fruit shows."""

from __future__ import annotations

import math
from functools import lru_cache

import cv2
import numpy as np
import numpy.typing as npt

from drivers.twin.optics import Eye

Picture = npt.NDArray[np.uint8]
Floats = npt.NDArray[np.float32]
Array = npt.NDArray[np.float64]
Box = tuple[int, int, int, int]

GRID_PX = 8
SLOTS = 127
_LEAST_PX = 4  # OpenCV takes arrays of few elements for scalars


class Rays:
    """The pixels of one eye as rays.

    What is a smooth function of the ray (its products, quadratic forms) is worked out exactly on a grid of Chebyshev
    nodes over a box of the image and carried to every pixel by polynomials: exact without lens distortion (degree 2),
    else within 1e-5 px (degree 6). ``grid`` (rows, columns, 3) holds the rays at the middles of squares of ``GRID_PX``
    pixels, one square more than the image on every side.
    """

    def __init__(self, eye: Eye, image_size: tuple[int, int]) -> None:
        self.eye = eye
        self.width, self.height = image_size
        columns, rows = (math.ceil(size / GRID_PX) + 2 for size in image_size)
        places = [(np.arange(count) - 0.5) * GRID_PX - 0.5 for count in (columns, rows)]
        grid = np.stack(np.meshgrid(*places), axis=-1)
        self.grid = np.ones((rows, columns, 3))
        self.grid[..., :2] = eye.rays(grid.reshape(-1, 2)).reshape(grid.shape)
        self._nodes = 7 if np.any(eye.dist) else 3
        corners = [(u, v) for u in (-0.5, 0.5 * self.width, self.width) for v in (-0.5, 0.5 * self.height, self.height)]
        rays = eye.rays(np.array(corners))
        self._low, self._high = rays.min(axis=0) - 0.02, rays.max(axis=0) + 0.02

    def may_see(self, centre_m: Array, radius_m: Array) -> npt.NDArray[np.bool_]:
        """(n,) whether balls, (n, 3) in the eye's frame, may be in the image."""
        depth = centre_m[:, 2]
        reach = 1.5 * radius_m[:, None]
        low = centre_m[:, :2] + reach > self._low * depth[:, None]
        high = centre_m[:, :2] - reach < self._high * depth[:, None]
        return np.asarray((depth + radius_m > 0.0) & low.all(axis=1) & high.all(axis=1))

    def at_nodes(self, boxes: npt.NDArray[np.int64]) -> Array:
        """(n, 2, k, k) rays at the nodes of boxes (n, 4)."""
        share = 0.5 + 0.5 * _chebyshev(self._nodes)
        first, last = boxes[:, None, :2] - 0.5, boxes[:, None, 2:] - 0.5
        places = first + share[:, None] * (last - first)
        k = self._nodes
        grid = np.empty((len(boxes), k, k, 2))
        grid[..., 0] = places[:, None, :, 0]
        grid[..., 1] = places[:, :, None, 1]
        return self.eye.rays(grid.reshape(-1, 2)).reshape(grid.shape).transpose(0, 3, 1, 2)

    def over_box(self, values: Array, box: Box) -> Floats:
        """(m, h, w) at every pixel of a box from values (m, k, k) at its nodes."""
        x0, y0, x1, y1 = box
        return _spread(values, _lagrange(y1 - y0, self._nodes), _lagrange(x1 - x0, self._nodes))

    def over_grid(self, values: Array, size: int) -> Floats:
        """(n, m, size, size) at the middles of ``size`` by ``size`` even parts of boxes from (n, m, k, k)."""
        return _spread(values, _lagrange(size, self._nodes), _lagrange(size, self._nodes))

    def per_pixel(self, pixels: Array) -> Array:
        """(n, 2, 2) change of the ray's x, y (rows) per pixel of u, v (columns)."""
        steps = np.array([[0.5, 0.0], [-0.5, 0.0], [0.0, 0.5], [0.0, -0.5]])
        rays = self.eye.rays((pixels[:, None] + steps).reshape(-1, 2)).reshape(-1, 4, 2)
        return np.stack([rays[:, 0] - rays[:, 1], rays[:, 2] - rays[:, 3]], axis=-1)

    def boxes(self, low: Array, high: Array, margin_px: float = 1.0) -> npt.NDArray[np.int64]:
        """(n, 4) parts x0, y0, x1, y1 of the image between pixels (n, 2), empty where x0 >= x1 or y0 >= y1."""
        edge = np.array([self.width, self.height], dtype=np.float64)
        first = np.clip(np.floor(low - margin_px), 0.0, edge)
        last = np.clip(np.ceil(high + margin_px) + 1.0, 0.0, edge)
        seen = (first < last).all(axis=1, keepdims=True)
        first = np.where(seen, np.minimum(first, edge - _LEAST_PX), first)
        last = np.where(seen, np.maximum(last, first + _LEAST_PX), last)
        return np.asarray(np.hstack([first, last]), dtype=np.int64)


def _chebyshev(count: int) -> Array:
    return np.asarray(np.cos(np.pi * (np.arange(count) + 0.5) / count))


@lru_cache(maxsize=2048)
def _lagrange(length: int, count: int) -> Floats:
    """(length, count) what each node gives to each place of a box's side."""
    nodes = _chebyshev(count)
    places = (np.arange(length) + 0.5) / length * 2.0 - 1.0
    out = np.ones((len(places), count))
    for k in range(count):
        for other in range(count):
            if other != k:
                out[:, k] *= (places - nodes[other]) / (nodes[k] - nodes[other])
    return out.astype(np.float32)


def _spread(values: Array, rows: Floats, columns: Floats) -> Floats:
    half = np.matmul(rows, values.astype(np.float32))
    flat = half.reshape(-1, half.shape[-1]) @ columns.T
    return np.asarray(flat.reshape(*half.shape[:-1], len(columns)))


class Canvas:
    """``picture`` (h, w, 4): BGR codes (see ``Illumination``) and which fruit shows: its slot, 1 to ``SLOTS``; 0 and
    values above are none; painted over ``backdrop``, in place.

    ``inverse_depth`` (h, w) is 1/z, 0 where only the backdrop is.
    """

    def __init__(self, backdrop: Picture) -> None:
        self.picture = backdrop
        self.inverse_depth: Floats = np.zeros(backdrop.shape[:2], np.float32)

    def put(self, box: Box, colour: Picture, inverse_depth: Floats) -> None:
        """Paint ``colour`` (h, w, 4) where its last channel is 255, not 0, and nothing nearer was painted."""
        x0, y0, x1, y1 = box
        behind = self.inverse_depth[y0:y1, x0:x1]
        nearer = cv2.compare(inverse_depth, behind, cv2.CMP_GT)
        shown = cv2.bitwise_and(nearer, cv2.extractChannel(colour, 3))
        cv2.copyTo(colour, shown, self.picture[y0:y1, x0:x1])
        cv2.copyTo(inverse_depth, shown, behind)

    def shown(self) -> npt.NDArray[np.int64]:
        """(SLOTS + 1,) pixels in which each slot shows."""
        return np.bincount(self.picture[..., 3].ravel(), minlength=256)[: SLOTS + 1]

"""The outline that a labelled fruit would have with nothing before it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.optimize import least_squares

Array = npt.NDArray[np.float64]

ANGLES = 96
_TURN = np.arange(ANGLES) * (2 * np.pi / ANGLES)
BOX_SIGMA_PX, AREA_SIGMA_PX, EDGE_SIGMA_PX = 0.5, 0.5, 1.0
FLATTENING_SIGMA = 0.1


@dataclass(frozen=True, slots=True)
class Outline:
    """Radius ``r_px * (1 + cos2 * cos(2 a) + sin2 * sin(2 a))`` at the angle a (from +u to +v) round (u_px, v_px)."""

    u_px: float
    v_px: float
    r_px: float
    cos2: float
    sin2: float

    def radii(self, turn_rad: npt.ArrayLike) -> Array:
        """Pixels, of the shape of ``turn_rad``."""
        turn = np.asarray(turn_rad, dtype=np.float64)
        return self.r_px * (1.0 + self.cos2 * np.cos(2 * turn) + self.sin2 * np.sin(2 * turn))

    def points(self, turn_rad: npt.ArrayLike) -> Array:
        """(..., 2) pixels."""
        turn = np.asarray(turn_rad, dtype=np.float64)
        out = self.radii(turn)[..., None] * np.stack([np.cos(turn), np.sin(turn)], axis=-1)
        return np.asarray(out + np.array([self.u_px, self.v_px]))

    def box(self) -> tuple[float, float, float, float]:
        """Left, top, right and bottom in pixels."""
        points = self.points(_TURN)
        low, high = points.min(axis=0), points.max(axis=0)
        return float(low[0]), float(low[1]), float(high[0]), float(high[1])


def outline_of_points(points_px: npt.ArrayLike) -> Outline:
    """The outline through exact points (n, 2) all round."""
    points = np.asarray(points_px, dtype=np.float64)
    start = np.array([*points.mean(axis=0), 0.0, 0.0, 0.0])
    start[2] = np.hypot(*(points - start[:2]).T).mean()
    fit = least_squares(_miss, start, method="lm", args=(points,))
    return Outline(*(float(value) for value in fit.x))


def outline_of_mask(skin: npt.NDArray[np.bool_], box: npt.ArrayLike, area_px2: float) -> Outline:
    """The outline by its whole box (left, top, right, bottom), its whole area, and the edge of the skin that shows.

    The box and the area say how large it is; the skin's edge, which may partly be that of a leaf before it, how it
    leans. A point far inside therefore counts little.
    """
    left, top, right, bottom = (float(value) for value in np.asarray(box, dtype=np.float64))
    centre = np.array([(left + right) / 2, (top + bottom) / 2])
    wide, high = (right - left) / 2, (bottom - top) / 2
    mean = float(np.sqrt(area_px2 / np.pi))
    edge = _skin_edge(skin, centre, 1.5 * max(wide, high))
    start = np.array([*centre, mean, np.clip((wide - high) / (wide + high), -0.3, 0.3), 0.0])
    goal = np.array([left, top, right, bottom])

    def misses(p: Array) -> Array:
        outline = Outline(*p)
        radii = outline.radii(_TURN)
        area = 0.5 * float((radii**2).sum()) * (2 * np.pi / ANGLES)
        parts = [
            (np.array(outline.box()) - goal) / BOX_SIGMA_PX,
            [(np.sqrt(max(area, 0.0) / np.pi) - mean) / AREA_SIGMA_PX],
            p[3:] / FLATTENING_SIGMA,
        ]
        if len(edge):
            miss = _miss(p, edge) / EDGE_SIGMA_PX
            parts.append(miss / np.sqrt(1.0 + miss**2) / np.sqrt(len(edge) / 12))
        return np.concatenate(parts)

    fit = least_squares(misses, start, diff_step=np.full(5, 1e-5))
    return Outline(*(float(value) for value in fit.x))


def _miss(p: Array, points: Array) -> Array:
    across = points - p[:2]
    turn = np.arctan2(across[:, 1], across[:, 0])
    return np.asarray(np.hypot(across[:, 0], across[:, 1]) - Outline(*p).radii(turn))


def _skin_edge(skin: npt.NDArray[np.bool_], centre: Array, reach_px: float) -> Array:
    """(n, 2) where the skin ends on rays from the centre, for the rays on which it ends inside the image."""
    height, width = skin.shape
    steps = np.arange(0.0, reach_px, 0.5)
    u = centre[0] + np.cos(_TURN)[:, None] * steps
    v = centre[1] + np.sin(_TURN)[:, None] * steps
    column, row = np.rint(u).astype(int), np.rint(v).astype(int)
    inside = (column >= 0) & (row >= 0) & (column < width) & (row < height)
    on = np.zeros(u.shape, dtype=bool)
    on[inside] = skin[row[inside], column[inside]]
    last = on.shape[1] - 1 - on[:, ::-1].argmax(axis=1)
    known = on.any(axis=1) & (last < on.shape[1] - 1)
    rows = np.flatnonzero(known)
    known[rows] = inside[rows, last[rows] + 1]
    rows = np.flatnonzero(known)
    reach = steps[last[rows]] + 0.25
    return np.column_stack([centre[0] + np.cos(_TURN[rows]) * reach, centre[1] + np.sin(_TURN[rows]) * reach])

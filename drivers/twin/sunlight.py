"""Which parts of fruit and leaves the sun reaches: shadow maps along the sun's rays."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from drivers.twin.raycast import HitKind, first_hit
from drivers.twin.solids import Greenhouse, TwinFruit

Array = npt.NDArray[np.float64]
Floats = npt.NDArray[np.float32]

GRID = 16
NEIGHBOURS = 3
_BUNDLE = 256
_CLOSE = 1.3  # neighbours nearer than this many contact distances darken each other
_CANOPY_GAPS = 0.75  # of the beam passes the plants above and behind that are not grown


@dataclass(frozen=True, slots=True, eq=False)
class Sunlight:
    """What the sun reaches, 0 to 1. ``leaves`` (n,); ``fruits`` (m, g, g) over -1..1 equatorial radii along ``up``
    (rows) and ``right`` (columns), which are square to the sun's rays, row frame."""

    right: Array
    up: Array
    leaves: Array
    fruits: Floats


def sunlight(greenhouse: Greenhouse, sun_direction: Array) -> Sunlight:
    """The shadows of a greenhouse under the sun in ``sun_direction`` (3,)."""
    helper = np.array([0.0, 0.0, 1.0]) if abs(sun_direction[2]) < 0.95 else np.array([1.0, 0.0, 0.0])
    right = np.cross(helper, sun_direction)
    right /= np.linalg.norm(right)
    up = np.cross(sun_direction, right)
    maps = [_on_fruit(greenhouse, fruit, sun_direction, right, up) for fruit in greenhouse.fruits]
    return Sunlight(
        right, up, _on_leaves(greenhouse, sun_direction), np.array(maps, dtype=np.float32).reshape(-1, GRID, GRID)
    )


def close_neighbours(fruits: tuple[TwinFruit, ...]) -> Array:
    """(m, 3, 3) unit vectors from each fruit to those that touch or nearly touch it, zeros where there are fewer."""
    out = np.zeros((len(fruits), NEIGHBOURS, 3))
    centres = np.array([fruit.centre_m for fruit in fruits]).reshape(-1, 3)
    radii = np.array([fruit.semi_equatorial_m for fruit in fruits])
    for k in range(len(fruits)):
        away = centres - centres[k]
        distance = np.linalg.norm(away, axis=1)
        near = np.flatnonzero((distance < _CLOSE * (radii + radii[k])) & (distance > 0.0))
        nearest = near[np.argsort(distance[near])][:NEIGHBOURS]
        out[k, : len(nearest)] = away[nearest] / distance[nearest, None]
    return out


def _on_fruit(greenhouse: Greenhouse, fruit: TwinFruit, sun_direction: Array, right: Array, up: Array) -> Floats:
    radius = fruit.semi_equatorial_m
    step = (np.arange(GRID) + 0.5) / GRID * 2.0 - 1.0
    v, u = (grid.reshape(-1, 1) for grid in np.meshgrid(step, step, indexing="ij"))
    front = np.sqrt(np.maximum(1.0 - u * u - v * v, 0.0)) * 1.02 + 0.01
    starts = fruit.centre_m + radius * (u * right + v * up + front * sun_direction)
    lit = _free(greenhouse, starts, sun_direction).reshape(GRID, GRID).astype(np.float32)
    return np.asarray(cv2.GaussianBlur(lit, (3, 3), 0.7) * np.float32(_CANOPY_GAPS), dtype=np.float32)


def _on_leaves(greenhouse: Greenhouse, sun_direction: Array) -> Array:
    """(n,) from nine places on each leaf."""
    leaves = greenhouse.leaves
    total = np.zeros(len(leaves))
    for a in (0.25, 0.5, 0.75):
        for b in (0.2, 0.5, 0.8):
            places = leaves.corner_m + a * leaves.u_m + b * leaves.v_m
            total += _free(greenhouse, places + 0.002 * sun_direction, sun_direction)
    return np.asarray(total / 9.0 * _CANOPY_GAPS)


def _free(greenhouse: Greenhouse, starts: Array, sun_direction: Array) -> Array:
    """(n,) 1 where the sun is seen; the glass of the far wall lets it through."""
    out = np.empty(len(starts))
    for k in range(0, len(starts), _BUNDLE):  # places that follow each other lie near each other
        some = starts[k : k + _BUNDLE]
        kinds, _, _ = first_hit(greenhouse, some, np.broadcast_to(sun_direction, some.shape))
        out[k : k + _BUNDLE] = (kinds == HitKind.AIR) | (kinds == HitKind.WALL)
    return out

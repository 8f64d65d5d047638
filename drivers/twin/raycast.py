"""What a straight ray meets first in the greenhouse."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from drivers.twin.ray_soups import NEAREST_M, CapsuleSoup, LeafSoup, SpheroidSoup
from drivers.twin.solids import Greenhouse

Array = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]


class HitKind(IntEnum):
    """What was met; AIR when nothing was."""

    AIR = 0
    FRUIT = 1
    LEAF = 2
    STEM = 3
    SOIL = 4
    WALL = 5


def first_hit(
    greenhouse: Greenhouse, origin_m: npt.ArrayLike, directions: npt.ArrayLike
) -> tuple[Ints, Ints, Array]:
    """Kinds (n,) of ``HitKind``, ids (n,) and distances_m (n,) of what rays meet first, row frame.

    ``origin_m`` is (3,) for all rays or (n, 3); ``directions`` (n, 3) need not be of unit length. The id is the fruit's
    own, or the index of the leaf or stem, or -1. Distance is inf in air. ``ValueError`` for a direction of length 0.
    """
    rays = np.asarray(directions, dtype=np.float64).reshape(-1, 3)
    length = np.linalg.norm(rays, axis=1, keepdims=True)
    if np.any(length == 0.0) or not np.all(np.isfinite(rays)):
        raise ValueError("directions: expected finite vectors longer than 0, found another; correct the direction")
    rays = rays / length
    origin = np.broadcast_to(np.asarray(origin_m, dtype=np.float64), rays.shape)
    kinds = np.zeros(len(rays), dtype=np.int64)
    ids = np.full(len(rays), -1, dtype=np.int64)
    distances = np.full(len(rays), np.inf)
    nameless = np.full(len(rays), -1, dtype=np.int64)

    def nearer(hit_m: Array, kind: HitKind, names: Ints) -> None:
        closer = hit_m < distances
        distances[closer] = hit_m[closer]
        kinds[closer] = kind
        ids[closer] = names[closer]

    soups = _soups(greenhouse)
    near = _near(soups.balls, origin, rays)
    fruit_count, leaf_count = len(greenhouse.fruits), len(greenhouse.leaves)
    for kind, chosen, hits, names in (
        (HitKind.FRUIT, near[:fruit_count], soups.fruits, soups.fruit_ids),
        (HitKind.LEAF, near[fruit_count : fruit_count + leaf_count], soups.leaves, np.arange(leaf_count)),
        (HitKind.STEM, near[fruit_count + leaf_count :], soups.stems, np.arange(len(greenhouse.stems))),
    ):
        index = np.flatnonzero(chosen)
        if len(index):
            table = hits.hit(index, origin, rays)
            best = np.argmin(table, axis=1)
            nearer(table[np.arange(len(rays)), best], kind, names[index[best]])
    nearer(_hit_plane(origin, rays, 2, 0.0), HitKind.SOIL, nameless)
    nearer(_hit_plane(origin, rays, 1, greenhouse.wall_y_m), HitKind.WALL, nameless)
    return kinds, ids, distances


@dataclass(frozen=True, slots=True, eq=False)
class _Soups:
    """A greenhouse as arrays. ``balls`` (m, 4): centre and radius round each fruit, leaf and stem, in that order."""

    balls: Array
    fruits: SpheroidSoup
    fruit_ids: Ints
    leaves: LeafSoup
    stems: CapsuleSoup


@lru_cache(maxsize=2)
def _soups(greenhouse: Greenhouse) -> _Soups:
    leaves, stems = greenhouse.leaves, greenhouse.stems
    fruit_balls = [[*fruit.centre_m, fruit.semi_equatorial_m] for fruit in greenhouse.fruits]
    stem_balls = [
        [*(0.5 * (stem.p0_m + stem.p1_m)), 0.5 * float(np.linalg.norm(stem.p1_m - stem.p0_m)) + stem.radius_m]
        for stem in stems
    ]
    return _Soups(
        balls=np.vstack(
            [
                np.array(fruit_balls).reshape(-1, 4),
                np.column_stack([leaves.centre_m, leaves.reach_m]),
                np.array(stem_balls).reshape(-1, 4),
            ]
        ),
        fruits=SpheroidSoup.of(greenhouse.fruits),
        fruit_ids=np.array([fruit.id for fruit in greenhouse.fruits], dtype=np.int64),
        leaves=LeafSoup.of(leaves),
        stems=CapsuleSoup.of(stems),
    )


def _near(balls: Array, origin_m: Array, rays: Array) -> npt.NDArray[np.bool_]:
    """Which balls (m, 4) the bundle of rays may meet: those that the cone round it touches."""
    if len(rays) == 0:
        return np.zeros(len(balls), dtype=np.bool_)
    start = origin_m.mean(axis=0)
    spread = float(np.max(np.linalg.norm(origin_m - start, axis=1)))
    axis = rays.mean(axis=0)
    length = float(np.linalg.norm(axis))
    if length < 0.2:
        return np.ones(len(balls), dtype=np.bool_)
    axis = axis / length
    opening = np.arccos(np.clip(np.min(rays @ axis), -1.0, 1.0))
    to_ball = balls[:, :3] - start
    distance = np.linalg.norm(to_ball, axis=1)
    radius = balls[:, 3] + spread
    outside = distance > radius
    angle = np.arccos(np.clip(to_ball @ axis / np.maximum(distance, 1e-12), -1.0, 1.0))
    width = np.arcsin(np.minimum(radius / np.maximum(distance, 1e-12), 1.0))
    return np.asarray(~outside | (angle <= opening + width + 1e-6))


def _hit_plane(origin_m: Array, rays: Array, axis: int, level_m: float) -> Array:
    slope = rays[:, axis]
    moving = np.abs(slope) > 1e-12
    hit = np.where(moving, (level_m - origin_m[:, axis]) / np.where(moving, slope, 1.0), np.inf)
    return np.where(hit > NEAREST_M, hit, np.inf)

"""Where the drops of a spray cone land."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache

import numpy as np
import numpy.typing as npt

from drivers.twin.raycast import HitKind, first_hit
from drivers.twin.solids import Greenhouse

Array = npt.NDArray[np.float64]

RAYS = 512


@dataclass(frozen=True, slots=True)
class Deposit:
    """Millilitres by where they landed; the parts add up to what left the nozzle.

    ``fruit_ml`` by fruit id; ``stem_ml`` holds stems, canes and trusses; ``air_ml`` flew past everything within reach.
    """

    fruit_ml: dict[int, float]
    leaf_ml: float
    stem_ml: float
    soil_ml: float
    air_ml: float

    @property
    def total_ml(self) -> float:
        return sum(self.fruit_ml.values()) + self.leaf_ml + self.stem_ml + self.soil_ml + self.air_ml


def deposit(
    greenhouse: Greenhouse,
    nozzle_m: npt.ArrayLike,
    axis: npt.ArrayLike,
    half_angle_rad: float,
    volume_ml: float,
    reach_m: float = 1.2,
) -> Deposit:
    """Share ``volume_ml`` out over a full cone, equal by solid angle; row frame, drops fly straight.

    What meets nothing within ``reach_m``, and what reaches the far wall, is in ``air_ml``.
    Raises ``ValueError`` for an axis of length 0, an angle outside 0 to 80 degrees or a negative volume or reach.
    """
    direction = np.asarray(axis, dtype=np.float64)
    length = float(np.linalg.norm(direction))
    if not (math.isfinite(length) and length > 0.0):
        raise ValueError(f"axis: expected a finite vector longer than 0, found length {length:g}; give the spray axis")
    if not 0.0 < half_angle_rad <= math.radians(80.0):
        raise ValueError(f"half_angle_rad: expected above 0 to 1.396, found {half_angle_rad:g}; give radians")
    if not (math.isfinite(volume_ml) and volume_ml >= 0.0 and reach_m > 0.0):
        raise ValueError(
            f"expected volume_ml >= 0 and reach_m > 0, found {volume_ml:g} ml and {reach_m:g} m; correct them"
        )
    rays = _cone(half_angle_rad) @ _frame(direction / length).T
    kinds, ids, distances = first_hit(greenhouse, nozzle_m, rays)
    kinds = np.where((distances > reach_m) | (kinds == HitKind.WALL), HitKind.AIR, kinds)
    share = volume_ml / RAYS

    def landed(kind: HitKind) -> float:
        return share * int(np.count_nonzero(kinds == kind))

    fruit_ids, counts = np.unique(ids[kinds == HitKind.FRUIT], return_counts=True)
    return Deposit(
        fruit_ml={int(id_): share * int(count) for id_, count in zip(fruit_ids, counts, strict=True)},
        leaf_ml=landed(HitKind.LEAF),
        stem_ml=landed(HitKind.STEM),
        soil_ml=landed(HitKind.SOIL),
        air_ml=landed(HitKind.AIR),
    )


@cache
def _cone(half_angle_rad: float) -> Array:
    """(RAYS, 3) unit vectors about +x, equal solid angle each, on a golden spiral."""
    k = np.arange(RAYS) + 0.5
    cosine = 1.0 - k / RAYS * (1.0 - math.cos(half_angle_rad))
    sine = np.sqrt(1.0 - cosine**2)
    turn = k * math.pi * (3.0 - math.sqrt(5.0))
    return np.column_stack([cosine, sine * np.cos(turn), sine * np.sin(turn)])


def _frame(forward: Array) -> Array:
    """(3, 3) rotation whose first column is ``forward``."""
    helper = np.array([0.0, 0.0, 1.0]) if abs(forward[2]) < 0.9 else np.array([1.0, 0.0, 0.0])
    left = np.cross(helper, forward)
    left /= np.linalg.norm(left)
    return np.column_stack([forward, left, np.cross(forward, left)])

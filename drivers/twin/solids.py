"""The solid shapes of the twin, in the row frame."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Rgb = tuple[float, float, float]
TwinRipeness = Literal["red", "turning", "green"]


@dataclass(frozen=True, slots=True, eq=False)
class Capsule:
    """A cylinder with round ends from ``p0_m`` to ``p1_m`` (3,); ``colour`` is its linear RGB reflectance, 0 to 1."""

    p0_m: Array
    p1_m: Array
    radius_m: float
    colour: Rgb = (0.08, 0.08, 0.09)


@dataclass(frozen=True, slots=True, eq=False)
class TwinFruit:
    """An oblate tomato. ``axis`` (3,) is the unit vector to its calyx.

    ``diameter_m`` is that of the sphere of equal volume; ``oblateness`` the polar over the equatorial diameter;
    ``colour`` the linear RGB reflectance of its flank, ``shoulder`` that of its top round the calyx.
    """

    id: int
    centre_m: Array
    diameter_m: float
    oblateness: float
    axis: Array
    ripeness: TwinRipeness
    colour: Rgb
    shoulder: Rgb

    @property
    def semi_equatorial_m(self) -> float:
        return float(0.5 * self.diameter_m * self.oblateness ** (-1.0 / 3.0))

    @property
    def semi_polar_m(self) -> float:
        return float(0.5 * self.diameter_m * self.oblateness ** (2.0 / 3.0))

    def shape(self) -> Array:
        """(3, 3) symmetric positive E: the surface is (x - c)' E (x - c) = 1."""
        along = np.outer(self.axis, self.axis)
        return np.asarray(
            (np.eye(3) - along) / self.semi_equatorial_m**2 + along / self.semi_polar_m**2, dtype=np.float64
        )


@dataclass(frozen=True, slots=True, eq=False)
class Leaves:
    """Flat leaves, each a texture on a parallelogram: ``corner_m + u * u_m + v * v_m`` with u, v in 0..1, all (n, 3).

    ``texture`` (n,) is the index of the leaf's shape and venation; ``tint`` (n, 3) multiplies its RGB reflectance.
    """

    corner_m: Array
    u_m: Array
    v_m: Array
    texture: npt.NDArray[np.int64]
    tint: Array

    def __len__(self) -> int:
        return len(self.corner_m)

    @property
    def centre_m(self) -> Array:
        return np.asarray(self.corner_m + 0.5 * (self.u_m + self.v_m))

    @property
    def reach_m(self) -> Array:
        """(n,) radius of a ball round each leaf."""
        return np.asarray(0.5 * (np.linalg.norm(self.u_m, axis=1) + np.linalg.norm(self.v_m, axis=1)))

    @property
    def normal(self) -> Array:
        normal = np.cross(self.u_m, self.v_m)
        return np.asarray(normal / np.linalg.norm(normal, axis=1, keepdims=True))


@dataclass(frozen=True, slots=True, eq=False)
class Greenhouse:
    """Everything that stands still: fruit, leaves, stems (vines, canes, trusses), soil at z = 0 and a wall.

    ``supports`` are the vertical canes among ``stems``. The wall is the plane y = ``wall_y_m`` with a second row of
    plants before it, as a picture. ``seed`` draws the pictures of soil and wall.
    """

    fruits: tuple[TwinFruit, ...]
    leaves: Leaves
    stems: tuple[Capsule, ...]
    supports: tuple[Capsule, ...]
    wall_y_m: float
    seed: int

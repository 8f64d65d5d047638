"""Rays against many solids of one kind at once: n rays by m solids."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from drivers.twin.leaf_pictures import PICTURES, SIZE_PX, leaf_coverage
from drivers.twin.solids import Capsule, Leaves, TwinFruit

Array = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

NEAREST_M = 1e-6  # a ray that starts on a surface leaves it


@dataclass(frozen=True, slots=True, eq=False)
class SpheroidSoup:
    """Centres (m, 3) and shapes (m, 3, 3)."""

    centre_m: Array
    shape: Array

    @classmethod
    def of(cls, fruits: Sequence[TwinFruit]) -> SpheroidSoup:
        return cls(
            np.array([fruit.centre_m for fruit in fruits]).reshape(-1, 3),
            np.array([fruit.shape() for fruit in fruits]).reshape(-1, 3, 3),
        )

    def hit(self, index: Ints, origin_m: Array, rays: Array) -> Array:
        """(n, len(index)) distances to the chosen spheroids, inf where missed."""
        shape = self.shape[index]
        bent = np.einsum("ni,mij->nmj", rays, shape)
        start = origin_m[:, None] - self.centre_m[index]
        a = np.einsum("nmj,nj->nm", bent, rays)
        b = np.einsum("nmj,nmj->nm", bent, start)
        c = np.einsum("nmi,nmi->nm", np.einsum("nmi,mij->nmj", start, shape), start) - 1.0
        disc = b * b - a * c
        root = np.sqrt(np.maximum(disc, 0.0))
        enter, leave = (-b - root) / a, (-b + root) / a
        hit = np.where(enter > NEAREST_M, enter, leave)
        return np.where((disc >= 0.0) & (hit > NEAREST_M), hit, np.inf)


@dataclass(frozen=True, slots=True, eq=False)
class LeafSoup:
    """Corners, normals and the two vectors that give u and v of a point of the plane, all (m, 3); pictures (m,)."""

    corner_m: Array
    normal: Array
    u_dual: Array
    v_dual: Array
    texture: Ints

    @classmethod
    def of(cls, leaves: Leaves) -> LeafSoup:
        normal = leaves.normal
        u_dual = np.cross(leaves.v_m, normal)
        v_dual = np.cross(normal, leaves.u_m)
        area = np.einsum("mi,mi->m", u_dual, leaves.u_m)[:, None]
        return cls(leaves.corner_m, normal, u_dual / area, v_dual / area, leaves.texture)

    def hit(self, index: Ints, origin_m: Array, rays: Array) -> Array:
        """(n, len(index)) distances to the chosen leaves where their picture covers, else inf."""
        corner, normal = self.corner_m[index], self.normal[index]
        slope = rays @ normal.T
        facing = np.abs(slope) > 1e-12
        ahead = np.einsum("mi,mi->m", corner, normal) - origin_m @ normal.T
        hit = np.where(facing, ahead / np.where(facing, slope, 1.0), -1.0)
        u = self._place(self.u_dual[index], corner, origin_m, rays, hit)
        v = self._place(self.v_dual[index], corner, origin_m, rays, hit)
        inside = (u >= 0) & (u < SIZE_PX) & (v >= 0) & (v < SIZE_PX) & (hit > NEAREST_M)
        out = np.full(hit.shape, np.inf)
        ray, leaf = np.nonzero(inside)
        coverage = np.stack([leaf_coverage(k) for k in range(PICTURES)])
        covered = coverage[self.texture[index[leaf]], v[ray, leaf], u[ray, leaf]]
        out[ray[covered], leaf[covered]] = hit[ray[covered], leaf[covered]]
        return out

    @staticmethod
    def _place(dual: Array, corner: Array, origin_m: Array, rays: Array, hit: Array) -> Ints:
        share = origin_m @ dual.T - np.einsum("mi,mi->m", corner, dual) + hit * (rays @ dual.T)
        return np.asarray(np.floor(np.clip(share, -1.0, 2.0) * SIZE_PX), dtype=np.int64)


@dataclass(frozen=True, slots=True, eq=False)
class CapsuleSoup:
    """Ends (m, 3) and radii (m,)."""

    p0_m: Array
    p1_m: Array
    radius_m: Array

    @classmethod
    def of(cls, capsules: Sequence[Capsule]) -> CapsuleSoup:
        return cls(
            np.array([capsule.p0_m for capsule in capsules]).reshape(-1, 3),
            np.array([capsule.p1_m for capsule in capsules]).reshape(-1, 3),
            np.array([capsule.radius_m for capsule in capsules]),
        )

    def hit(self, index: Ints, origin_m: Array, rays: Array) -> Array:
        """(n, len(index)) distances to the chosen capsules, inf where missed or where a ray starts inside."""
        p0, p1, radius = self.p0_m[index], self.p1_m[index], self.radius_m[index]
        axis = p1 - p0
        axis2 = np.einsum("mi,mi->m", axis, axis)
        ray_along = rays @ axis.T
        start_along = origin_m @ axis.T - np.einsum("mi,mi->m", p0, axis)
        ray_start = np.einsum("ni,ni->n", rays, origin_m)[:, None] - rays @ p0.T
        a = axis2 - ray_along**2
        b = axis2 * ray_start - start_along * ray_along
        c = axis2 * (self._square(origin_m, p0) - radius**2) - start_along**2
        disc = b * b - a * c
        usable = (disc >= 0.0) & (a > 1e-15)
        hit = np.where(usable, (-b - np.sqrt(np.maximum(disc, 0.0))) / np.where(usable, a, 1.0), -1.0)
        along = start_along + hit * ray_along
        best = np.where((along >= 0.0) & (along <= axis2) & (hit > NEAREST_M), hit, np.inf)
        for end in (p0, p1):
            b = np.einsum("ni,ni->n", rays, origin_m)[:, None] - rays @ end.T
            disc = b * b - self._square(origin_m, end) + radius**2
            hit = -b - np.sqrt(np.maximum(disc, 0.0))
            best = np.minimum(best, np.where((disc >= 0.0) & (hit > NEAREST_M), hit, np.inf))
        return np.asarray(best)

    @staticmethod
    def _square(origin_m: Array, end_m: Array) -> Array:
        """(n, m) squared distances, without the cancellation of expanded squares."""
        away = origin_m[:, None] - end_m
        return np.asarray(np.einsum("nmi,nmi->nm", away, away))

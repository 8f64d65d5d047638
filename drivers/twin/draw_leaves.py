"""Leaves into a canvas: textured parallelograms through their perspective."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from drivers.twin.canvas import Box, Canvas, Picture, Rays
from drivers.twin.illumination import Illumination
from drivers.twin.leaf_pictures import LEVELS, leaf_extents, leaf_picture
from drivers.twin.solids import Leaves

Array = npt.NDArray[np.float64]

_CODES = np.arange(256, dtype=np.float32)[:, None]
_COUNT = np.arange(8192, dtype=np.float32)
_THROUGH = np.array([0.10, 0.42, 0.22])  # of the light from behind, BGR, over the reflectance's share
_NEAREST_M = 0.08
_EDGE_ON_PX2 = 4.0
_KEPT = 1024  # pictures in one light
_SHARPNESS = 0.6  # least picture pixels per image pixel


@dataclass(frozen=True, slots=True, eq=False)
class LeafView:
    """One leaf before one eye, with its front (``face`` 0) or back: ``onto`` (3, 3) takes its picture of ``level``
    pixels a side into its box, ``plane`` (3,) gives 1/z from u, v in the box and 1; for ``lamp_power`` (3,) see
    ``LitLeaves``."""

    leaf: int
    face: int
    depth_m: float
    box: Box
    onto: Array
    plane: npt.NDArray[np.float32]
    texture: int
    level: int
    lamp_power: Array | None


class LitLeaves:
    """Leaves in one light: what multiplies the codes of their pictures, worked out for both faces once."""

    def __init__(self, leaves: Leaves, light: Illumination, sunlit: Array) -> None:
        """``sunlit`` (n,) is the share of each leaf that the sun reaches."""
        self._tint = leaves.tint[:, ::-1]
        self._light = light
        self._lamp_on = bool(np.any(light.lamp > 0.0))
        self._power = np.stack([self._squared(leaves.normal * side, sunlit) for side in (1.0, -1.0)], axis=1)
        self._pictures: dict[tuple[int, int, int], Picture] = {}

    def _squared(self, normal: Array, sunlit: Array) -> Array:
        slope = normal @ self._light.sun_direction
        direct = np.maximum(slope, 0.0)[:, None] + np.maximum(-slope, 0.0)[:, None] * _THROUGH
        irradiance = self._light.sun * (sunlit[:, None] * direct) + self._light.ambient(normal[:, 2])
        return np.asarray(self._light.gain(irradiance * self._tint) ** 2)

    def lamp_power(self, chosen: npt.NDArray[np.int64], to_lamp: Array, normal: Array) -> Array | None:
        """(n, 3) what the lamp adds to the squared gains, None when it is off."""
        if not self._lamp_on:
            return None
        distance = np.linalg.norm(to_lamp, axis=1)
        facing = np.abs(np.einsum("ni,ni->n", normal, to_lamp)) / distance
        return np.asarray(self._light.gain(self._light.lamp_at(distance) * facing[:, None] * self._tint[chosen]) ** 2)

    def picture(self, view: LeafView) -> Picture:
        """The leaf's picture in codes of radiance; kept while no lamp moves with the camera."""
        if view.lamp_power is not None:
            return self._coloured(view)
        key = (view.leaf, view.face, view.level)
        picture = self._pictures.get(key)
        if picture is None:
            if len(self._pictures) >= _KEPT:
                self._pictures.clear()
            picture = self._pictures[key] = self._coloured(view)
        return picture

    def _coloured(self, view: LeafView) -> Picture:
        power = self._power[view.leaf, view.face]
        gain = np.sqrt(power if view.lamp_power is None else power + view.lamp_power).astype(np.float32)
        table = np.empty((256, 1, 4), np.uint8)
        table[:, 0, :3] = np.minimum(_CODES * gain + np.float32(0.5), np.float32(255.0))
        table[:, 0, 3] = np.arange(256)
        return np.asarray(cv2.LUT(leaf_picture(view.texture, view.level), table), dtype=np.uint8)


@dataclass(frozen=True, slots=True, eq=False)
class LeafSet:
    """Leaves as arrays in the row frame: see ``Leaves``."""

    leaves: Leaves
    centre_m: Array
    reach_m: Array
    normal: Array

    @classmethod
    def of(cls, leaves: Leaves) -> LeafSet:
        return cls(leaves, leaves.centre_m, leaves.reach_m, leaves.normal)

    def views(self, rays: Rays, eye_from_row: Array, lamp_m: Array, lit: LitLeaves) -> list[LeafView]:
        """The leaves that an eye may see."""
        rotation, shift = eye_from_row[:3, :3], eye_from_row[:3, 3]
        near = np.flatnonzero(rays.may_see(self.centre_m @ rotation.T + shift, self.reach_m))
        corner = self.leaves.corner_m[near] @ rotation.T + shift
        u, v = self.leaves.u_m[near] @ rotation.T, self.leaves.v_m[near] @ rotation.T
        quads = np.stack([corner, corner + u, corner + u + v, corner + v], axis=1)
        ahead = np.flatnonzero(quads[..., 2].min(axis=1) > _NEAREST_M)
        quads = quads[ahead]
        pixels = rays.eye.pixels((quads[..., :2] / quads[..., 2:]).reshape(-1, 2)).reshape(-1, 4, 2)
        low, high = _covered(pixels, leaf_extents()[self.leaves.texture[near[ahead]]])
        boxes = rays.boxes(low, high, 1.5)
        du, dv = pixels[:, 1] - pixels[:, 0], pixels[:, 3] - pixels[:, 0]
        broad = np.abs(du[:, 0] * dv[:, 1] - du[:, 1] * dv[:, 0]) > _EDGE_ON_PX2
        seen = np.flatnonzero((boxes[:, 0] < boxes[:, 2]) & (boxes[:, 1] < boxes[:, 3]) & broad)
        if len(seen) == 0:
            return []
        chosen = near[ahead[seen]]
        quads, boxes = quads[seen], boxes[seen]
        inside = pixels[seen] - boxes[:, None, :2]
        # 1/z of a plane is linear in the image: three corners tell it
        corners = np.concatenate([inside[:, [0, 1, 3]], np.ones((len(seen), 3, 1))], axis=2)
        planes = np.linalg.solve(corners, 1.0 / quads[:, [0, 1, 3], 2, None])[..., 0].astype(np.float32)
        extents = np.ptp(pixels[seen], axis=1).max(axis=1)
        levels = np.array(LEVELS)[np.searchsorted(-np.array(LEVELS), -_SHARPNESS * extents, side="right") - 1]
        onto = _homographies(inside, levels)
        eye_m = -rotation.T @ shift
        normal, centre = self.normal[chosen], self.centre_m[chosen]
        faces = (np.einsum("ni,ni->n", normal, eye_m - centre) < 0.0).astype(np.int64).tolist()
        lamp = lit.lamp_power(chosen, lamp_m - centre, normal)
        depths = quads[..., 2].mean(axis=1).tolist()
        names, textures, sizes = chosen.tolist(), self.leaves.texture[chosen].tolist(), levels.tolist()
        return [
            LeafView(
                leaf=names[k],
                face=faces[k],
                depth_m=depths[k],
                box=(box[0], box[1], box[2], box[3]),
                onto=onto[k],
                plane=planes[k],
                texture=textures[k],
                level=sizes[k],
                lamp_power=None if lamp is None else lamp[k],
            )
            for k, box in enumerate(boxes.tolist())
        ]


def _covered(corners: Array, extents: Array) -> tuple[Array, Array]:
    """Least and greatest pixel (n, 2) of the part of a leaf that its picture covers; ``extents`` (n, 4) in u, v."""
    onto = _homographies(corners, np.ones(len(corners), dtype=np.int64))
    onto[:, :, 2] -= 0.5 * (onto[:, :, 0] + onto[:, :, 1])
    u, v = extents[:, [0, 2, 2, 0]], extents[:, [1, 1, 3, 3]]
    places = onto @ np.stack([u, v, np.ones_like(u)], axis=1)
    pixels = places[:, :2] / places[:, 2:]
    return pixels.min(axis=2), pixels.max(axis=2)


def _homographies(corners: Array, sizes: npt.NDArray[np.int64]) -> Array:
    """(n, 3, 3) from pictures of (n,) pixels a side onto their corners (n, 4, 2) in the order uv = 00 10 11 01.

    From the unit square (Heckbert 1989, section 2.2.3), after pictures whose pixel middles lie at integers.
    """
    p0, p1, p2, p3 = np.moveaxis(corners, 1, 0)
    d1, d2, s = p1 - p2, p3 - p2, p0 - p1 + p2 - p3
    area = d1[:, 0] * d2[:, 1] - d1[:, 1] * d2[:, 0]
    g = ((s[:, 0] * d2[:, 1] - s[:, 1] * d2[:, 0]) / area)[:, None]
    h = ((d1[:, 0] * s[:, 1] - d1[:, 1] * s[:, 0]) / area)[:, None]
    out = np.ones((len(corners), 3, 3))
    out[:, :2, 0], out[:, :2, 1], out[:, :2, 2] = p1 - p0 + g * p1, p3 - p0 + h * p3, p0
    out[:, 2, 0], out[:, 2, 1] = g[:, 0], h[:, 0]
    out[:, :, :2] /= sizes[:, None, None]
    out[:, :, 2] += 0.5 * (out[:, :, 0] + out[:, :, 1])
    return out


def draw_leaf(canvas: Canvas, lit: LitLeaves, view: LeafView) -> None:
    x0, y0, x1, y1 = view.box
    warped = cv2.warpPerspective(lit.picture(view), view.onto, (x1 - x0, y1 - y0), flags=cv2.INTER_NEAREST)
    a, b, c = view.plane
    inverse_depth = (a * _COUNT[: x1 - x0] + c) + (b * _COUNT[: y1 - y0])[:, None]
    canvas.put(view.box, np.asarray(warped, dtype=np.uint8), inverse_depth)

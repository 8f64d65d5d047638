"""Leaves into a canvas: textured parallelograms through their perspective."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from drivers.twin.canvas import Box, Canvas, Floats, Picture, Rays
from drivers.twin.illumination import Illumination
from drivers.twin.leaf_pictures import LEVELS, leaf_extents, leaf_picture
from drivers.twin.solids import Leaves

Array = npt.NDArray[np.float64]

_CODES = np.arange(256, dtype=np.float32)[:, None]
_SOLID = np.where(np.arange(256) > 127, 255, 0)  # coverage of one half and more
_THROUGH = np.array([0.10, 0.42, 0.22])  # of the light from behind, BGR, over the reflectance's share
_NEAREST_M = 0.08
_EDGE_ON_PX2 = 4.0
_KEPT = 1024  # pictures in one light
_SHARPNESS = 0.6  # least picture pixels per image pixel


@dataclass(frozen=True, slots=True, eq=False)
class LeafView:
    """One leaf before one eye, with its front (``face`` 0) or back: ``onto`` (3, 3) takes its picture of ``level``
    pixels a side into its box, where 1/z is ``along_u`` (w,) plus ``along_v`` (h,); for ``lamp_power`` (3,) see
    ``LitLeaves``."""

    leaf: int
    face: int
    depth_m: float
    box: Box
    onto: Array
    along_u: Floats
    along_v: Floats
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
        """Its picture in codes of radiance, the last channel 255 or 0; kept while no lamp moves with the camera."""
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
        table[:, 0, 3] = _SOLID
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

    def views(
        self, eyes: Sequence[Rays], eyes_from_row: Sequence[Array], lamp_m: Array, lit: LitLeaves
    ) -> list[list[LeafView]]:
        """By eye, the leaves that it may see."""
        before = [self._before(rays, eye_from_row) for rays, eye_from_row in zip(eyes, eyes_from_row, strict=True)]
        chosen = np.concatenate([some for some, _, _ in before])
        quads: Array = np.concatenate([some for _, some, _ in before])
        pixels: Array = np.concatenate([some for _, _, some in before])
        eye = np.repeat(np.arange(len(eyes)), [len(some) for some, _, _ in before])
        low, high = _covered(pixels, leaf_extents()[self.leaves.texture[chosen]])
        boxes = eyes[0].boxes(low, high, 1.5)
        du, dv = pixels[:, 1] - pixels[:, 0], pixels[:, 3] - pixels[:, 0]
        broad = np.abs(du[:, 0] * dv[:, 1] - du[:, 1] * dv[:, 0]) > _EDGE_ON_PX2
        seen = np.flatnonzero((boxes[:, 0] < boxes[:, 2]) & (boxes[:, 1] < boxes[:, 3]) & broad)
        views: list[list[LeafView]] = [[] for _ in eyes]
        if len(seen) == 0:
            return views
        chosen, quads, pixels, boxes, eye = chosen[seen], quads[seen], pixels[seen], boxes[seen], eye[seen]
        inside = pixels - boxes[:, None, :2]
        # 1/z of a plane is linear in the image: three corners tell it
        corners = np.concatenate([inside[:, [0, 1, 3]], np.ones((len(seen), 3, 1))], axis=2)
        planes = np.linalg.solve(corners, 1.0 / quads[:, [0, 1, 3], 2, None])
        along_u = np.asarray(planes[:, 0] * np.arange(eyes[0].width) + planes[:, 2], dtype=np.float32)
        along_v = np.asarray(planes[:, 1] * np.arange(eyes[0].height), dtype=np.float32)
        extents = np.ptp(pixels, axis=1).max(axis=1)
        levels = np.array(LEVELS)[np.searchsorted(-np.array(LEVELS), -_SHARPNESS * extents, side="right") - 1]
        onto = _homographies(inside, levels)
        eyes_m = np.array([-pose[:3, :3].T @ pose[:3, 3] for pose in eyes_from_row])
        normal, centre = self.normal[chosen], self.centre_m[chosen]
        faces = (np.einsum("ni,ni->n", normal, eyes_m[eye] - centre) < 0.0).astype(np.int64).tolist()
        lamp = lit.lamp_power(chosen, lamp_m - centre, normal)
        depths = quads[..., 2].mean(axis=1).tolist()
        names, textures, sizes = chosen.tolist(), self.leaves.texture[chosen].tolist(), levels.tolist()
        owners, boxes_px = eye.tolist(), boxes.tolist()
        for k, (x0, y0, x1, y1) in enumerate(boxes_px):
            views[owners[k]].append(
                LeafView(
                    leaf=names[k],
                    face=faces[k],
                    depth_m=depths[k],
                    box=(x0, y0, x1, y1),
                    onto=onto[k],
                    along_u=along_u[k, : x1 - x0],
                    along_v=along_v[k, : y1 - y0],
                    texture=textures[k],
                    level=sizes[k],
                    lamp_power=None if lamp is None else lamp[k],
                )
            )
        return views

    def _before(self, rays: Rays, eye_from_row: Array) -> tuple[npt.NDArray[np.int64], Array, Array]:
        """The (n,) leaves that may be in the image, their corners (n, 4, 3) in the eye's frame and pixels (n, 4, 2)."""
        rotation, shift = eye_from_row[:3, :3], eye_from_row[:3, 3]
        near = np.flatnonzero(rays.may_see(self.centre_m @ rotation.T + shift, self.reach_m))
        corner = self.leaves.corner_m[near] @ rotation.T + shift
        u, v = self.leaves.u_m[near] @ rotation.T, self.leaves.v_m[near] @ rotation.T
        quads = np.stack([corner, corner + u, corner + u + v, corner + v], axis=1)
        ahead = np.flatnonzero(quads[..., 2].min(axis=1) > _NEAREST_M)
        quads = quads[ahead]
        pixels = rays.eye.pixels((quads[..., :2] / quads[..., 2:]).reshape(-1, 2)).reshape(-1, 4, 2)
        return near[ahead], quads, pixels


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
    inverse_depth = view.along_u + view.along_v[:, None]
    canvas.put(view.box, np.asarray(warped, dtype=np.uint8), inverse_depth)

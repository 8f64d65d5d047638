"""Stems, canes and the arm into a canvas: shaded strips with round ends."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from drivers.twin.canvas import Box, Canvas, Rays
from drivers.twin.illumination import Illumination
from drivers.twin.solids import Capsule

Array = npt.NDArray[np.float64]

_NEAREST_M = 0.06
_SHIFT = 6
_THIN_PX = 8.0
_FLAT = 0.06
_WIDTHS = np.array([1.0, 0.8, 0.55, 0.25])  # of the radius, each strip over the last
_OFFSETS = np.array([0.0, 0.12, 0.2, 0.28])  # to the lit side
_TURN = np.linspace(-0.5 * np.pi, 0.5 * np.pi, 9)
_CAP = np.concatenate(  # (18, 2) along and across: two half circles
    [np.column_stack([np.cos(_TURN), np.sin(_TURN)]), np.column_stack([-np.cos(_TURN), -np.sin(_TURN)])]
)


@dataclass(frozen=True, slots=True, eq=False)
class CapsuleView:
    """A capsule before one eye: ``strips`` (s, n, 2) fixed-point polygons in its box and their colours (s, 3);
    ``ramp`` (3,) gives its place along itself, 0 to 1, from u, v, 1, ``inverse_depths`` 1/z at both
    ends; ``thin`` is a few pixels wide."""

    depth_m: float
    box: Box
    strips: npt.NDArray[np.int32]
    colours: list[list[int]]
    ramp: Array
    inverse_depths: tuple[float, float]
    thin: bool


@dataclass(frozen=True, slots=True, eq=False)
class CapsuleSet:
    """Capsules as arrays in the row frame: ends (m, 3), radii (m,), reflectances (m, 3) BGR."""

    p0_m: Array
    p1_m: Array
    radius_m: Array
    colour: Array

    @classmethod
    def of(cls, capsules: Sequence[Capsule]) -> CapsuleSet:
        return cls(
            np.array([capsule.p0_m for capsule in capsules], dtype=np.float64).reshape(-1, 3),
            np.array([capsule.p1_m for capsule in capsules], dtype=np.float64).reshape(-1, 3),
            np.array([capsule.radius_m for capsule in capsules], dtype=np.float64),
            np.array([capsule.colour[::-1] for capsule in capsules], dtype=np.float64).reshape(-1, 3),
        )

    def views(
        self, eyes: Sequence[Rays], eyes_from_row: Sequence[Array], lamp_m: Array, light: Illumination
    ) -> list[list[CapsuleView]]:
        """By eye, the capsules that it may see, lit."""
        views: list[list[CapsuleView]] = [[] for _ in eyes]
        if len(self.radius_m) == 0:
            return views
        before = [self._before(rays, eye_from_row) for rays, eye_from_row in zip(eyes, eyes_from_row, strict=True)]
        chosen, depths, ends, radii = (np.concatenate(parts) for parts in zip(*before, strict=True))
        eye = np.repeat(np.arange(len(eyes)), [len(some) for some, _, _, _ in before])
        boxes = eyes[0].boxes((ends - radii[..., None]).min(axis=1), (ends + radii[..., None]).max(axis=1))
        seen = np.flatnonzero((boxes[:, 0] < boxes[:, 2]) & (boxes[:, 1] < boxes[:, 3]))
        chosen, ends, radii, boxes, depths = chosen[seen], ends[seen], radii[seen], boxes[seen], depths[seen]
        along = ends[:, 1] - ends[:, 0]
        length = np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-6)
        unit = along / length
        unit[length[:, 0] <= 1e-6] = [1.0, 0.0]
        across = np.column_stack([-unit[:, 1], unit[:, 0]])
        suns = np.array([(pose[:3, :3] @ light.sun_direction)[:2] for pose in eyes_from_row])[eye[seen]]
        lit_side = np.where(np.einsum("ni,ni->n", across, suns) >= 0.0, 1.0, -1.0)
        polygons = _polygons(ends - boxes[:, None, :2], radii, unit, across, lit_side)
        colours = self._colours(chosen, lamp_m, light)
        inverse = (1.0 / np.maximum(depths - 0.8 * self.radius_m[chosen, None], 0.02)).tolist()
        thin = (radii.max(axis=1) < _THIN_PX).tolist()
        ramp = np.column_stack([unit / length, -np.einsum("ni,ni->n", ends[:, 0], unit) / length[:, 0]])
        owners, middles = eye[seen].tolist(), depths.mean(axis=1).tolist()
        for k, box in enumerate(boxes.tolist()):
            views[owners[k]].append(
                CapsuleView(
                    depth_m=middles[k],
                    box=(box[0], box[1], box[2], box[3]),
                    strips=polygons[k],
                    colours=colours[k],
                    ramp=ramp[k],
                    inverse_depths=(inverse[k][0], inverse[k][1]),
                    thin=thin[k],
                )
            )
        return views

    def _before(self, rays: Rays, eye_from_row: Array) -> tuple[npt.NDArray[np.int64], Array, Array, Array]:
        """The (n,) capsules that may be in the image; of both ends the depths (n, 2), pixels (n, 2, 2) and radii in
        pixels (n, 2)."""
        rotation, shift = eye_from_row[:3, :3], eye_from_row[:3, 3]
        first, last = self.p0_m @ rotation.T + shift, self.p1_m @ rotation.T + shift
        reach = 0.5 * np.linalg.norm(last - first, axis=1) + self.radius_m
        possible = rays.may_see(0.5 * (first + last), reach)
        ahead = np.flatnonzero(possible & (np.maximum(first[:, 2], last[:, 2]) > _NEAREST_M))
        first, last = first[ahead], last[ahead]
        first, last = _cut(first, last), _cut(last, first)
        depths = np.column_stack([first[:, 2], last[:, 2]])
        points = np.stack([first[:, :2] / first[:, 2:], last[:, :2] / last[:, 2:]], axis=1)
        ends = rays.eye.pixels(points.reshape(-1, 2)).reshape(-1, 2, 2)
        return ahead, depths, ends, rays.eye.K[0, 0] * self.radius_m[ahead, None] / depths

    def _colours(self, chosen: npt.NDArray[np.int64], lamp_m: Array, light: Illumination) -> list[list[list[int]]]:
        """(n, s, 3) codes of the strips: a thin round body shows every normal across itself."""
        p0, p1 = self.p0_m[chosen], self.p1_m[chosen]
        along = (p1 - p0) / np.maximum(np.linalg.norm(p1 - p0, axis=1, keepdims=True), 1e-9)
        rise = 0.15 + 0.5 * np.sqrt(np.maximum(1.0 - along[:, 2] ** 2, 0.0))
        cross = np.sqrt(np.maximum(1.0 - (along @ light.sun_direction) ** 2, 0.0))[:, None, None]
        lamp = light.lamp_at(np.linalg.norm(lamp_m - 0.5 * (p0 + p1), axis=1))[:, None]
        facing = np.sqrt(1.0 - 0.95 * _WIDTHS**2)[:, None]
        around = light.ambient(rise)[:, None] * (0.7 + 0.3 * facing)
        irradiance = around + 0.45 * light.sun * cross * facing + lamp * facing
        codes = 255.0 * light.gain(irradiance * self.colour[chosen][:, None]) + 0.5
        listed: list[list[list[int]]] = np.minimum(codes, 255.0).astype(np.int64).tolist()
        return listed


def _cut(point: Array, other: Array) -> Array:
    """(n, 3) points, or where the lines to the other ones come within sight."""
    hidden = point[:, 2] < _NEAREST_M
    span = np.where(hidden, other[:, 2] - point[:, 2], 1.0)
    share = np.where(hidden, (_NEAREST_M - point[:, 2]) / np.where(span > 0.0, span, 1.0), 0.0)[:, None]
    return np.asarray(point + share * (other - point))


def _polygons(ends: Array, radii: Array, unit: Array, across: Array, lit_side: Array) -> npt.NDArray[np.int32]:
    """(n, s, 18, 2) fixed-point outlines of the strips."""
    round_end = np.repeat([1, 0], len(_TURN))
    axes = np.stack([unit, across], axis=1)
    shape = np.einsum("pa,nai->npi", _CAP, axes)
    push = (_OFFSETS * (1.0 - _WIDTHS))[None, :, None, None] * (lit_side[:, None] * across)[:, None, None]
    local = _WIDTHS[None, :, None, None] * shape[:, None] + push
    out = ends[:, round_end][:, None] + radii[:, round_end][:, None, :, None] * local
    return np.asarray(np.round(out * 2**_SHIFT), dtype=np.int32)


def draw_capsule(canvas: Canvas, view: CapsuleView) -> None:
    """Paint one capsule: a thin one that runs across the view straight over what is there, others by their depth."""
    x0, y0, x1, y1 = view.box
    first, last = view.inverse_depths
    if view.thin and abs(last - first) < _FLAT * last:
        picture, inverse_depth = canvas.picture[y0:y1, x0:x1], canvas.inverse_depth[y0:y1, x0:x1]
        for polygon, code in zip(view.strips[::2], view.colours[::2], strict=True):
            cv2.fillConvexPoly(picture, polygon, (*code, 255), cv2.LINE_8, _SHIFT)
        cv2.fillConvexPoly(inverse_depth, view.strips[0], 0.5 * (first + last), cv2.LINE_8, _SHIFT)
        return
    colour = np.zeros((y1 - y0, x1 - x0, 4), np.uint8)
    for polygon, code in zip(view.strips, view.colours, strict=True):
        cv2.fillConvexPoly(colour, polygon, (*code, 255), cv2.LINE_8, _SHIFT)
    a, b, c = view.ramp
    share = np.add.outer((np.arange(y0, y1) * b + c).astype(np.float32), (np.arange(x0, x1) * a).astype(np.float32))
    np.maximum(share, np.float32(0.0), out=share)
    np.minimum(share, np.float32(1.0), out=share)
    share *= np.float32(last - first)
    share += np.float32(first)
    canvas.put(view.box, colour, share)

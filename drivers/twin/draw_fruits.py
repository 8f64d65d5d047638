"""Fruit into a canvas: every pixel's ray against the spheroid, edges by covered area."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from drivers.twin.canvas import SLOTS, Box, Canvas, Floats, Picture, Rays
from drivers.twin.fruit_shading import FruitSkins, shade_fruits
from drivers.twin.illumination import Illumination
from drivers.twin.solids import TwinFruit
from drivers.twin.sunlight import Sunlight

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]
Mask = npt.NDArray[np.bool_]

_NEAREST_M = 0.15
_EDGE_PX = 0.7072  # half the diagonal of a pixel
_SHADING_GRID = 22
_NINE_U, _NINE_V = (grid.ravel() for grid in np.meshgrid(np.arange(3), np.arange(3)))


@dataclass(frozen=True, slots=True, eq=False)
class FruitSight:
    """A fruit before one eye, ready to paint: over its ``box`` the ``colour`` (h, w, 4) with its ``slot``, 1/z, and
    where the pixels' middles and the ``whole`` pixels lie within its contour; for the pixels that the contour may cut
    their rows and columns ``rim``, the covered ``part`` (n, 4) of each channel and ``ink`` (n, 4), which is
    part * colour ** 2. The last channel is not mixed: its part is 0 or 1."""

    index: int
    slot: int
    depth_m: float
    box: Box
    colour: Picture
    inverse_depth: Floats
    within: Mask
    whole: Mask
    rim: tuple[Indices, Indices]
    part: Floats
    ink: Floats


@dataclass(frozen=True, slots=True, eq=False)
class _Seen:
    """The (m,) fruit an eye may see, in its frame: boxes (m, 4), the rays over them (m, 2, g, g); for ``forms``,
    ``slope`` and ``middle`` see ``_forms``."""

    index: Indices
    centre: Array
    shape: Array
    boxes: Indices
    grid: Floats
    forms: Array
    slope: Floats
    middle: Floats


@dataclass(frozen=True, slots=True, eq=False)
class FruitSet:
    """Fruit as arrays in the row frame: centres (m, 3), equatorial radii (m,), shapes (m, 3, 3)."""

    centre_m: Array
    radius_m: Array
    shape: Array
    skins: FruitSkins

    @classmethod
    def of(cls, fruits: tuple[TwinFruit, ...]) -> FruitSet:
        return cls(
            np.array([fruit.centre_m for fruit in fruits]).reshape(-1, 3),
            np.array([fruit.semi_equatorial_m for fruit in fruits]),
            np.array([fruit.shape() for fruit in fruits]).reshape(-1, 3, 3),
            FruitSkins.of(fruits),
        )

    def views(
        self,
        eyes: Sequence[Rays],
        eyes_from_row: Sequence[Array],
        lamp_m: Array,
        light: Illumination,
        sun: Sunlight,
    ) -> list[list[FruitSight]]:
        """By eye, the fruit it may see, lit; slots are the same in all eyes, fruit beyond ``SLOTS`` are left out."""
        slots: dict[int, int] = {}
        seen = [
            self._seen(rays, eye_from_row, slots) for rays, eye_from_row in zip(eyes, eyes_from_row, strict=True)
        ]
        counts = [len(some.index) for some in seen]
        if sum(counts) == 0:
            return [[] for _ in seen]
        codes = shade_fruits(
            self.skins,
            np.concatenate([some.index for some in seen]),
            np.concatenate([some.grid for some in seen]),
            np.concatenate([some.centre for some in seen]),
            np.concatenate([some.shape for some in seen]),
            np.repeat(np.stack(eyes_from_row), counts, axis=0),
            lamp_m,
            light,
            sun,
        )
        codes[..., 3] = np.array([slots[index] for some in seen for index in some.index.tolist()])[:, None, None]
        of_eyes = np.split(codes, np.cumsum(counts)[:-1])
        return [_sights(rays, some, own, slots) for rays, some, own in zip(eyes, seen, of_eyes, strict=True)]

    def _seen(self, rays: Rays, eye_from_row: Array, slots: dict[int, int]) -> _Seen:
        """What an eye may see, with tight boxes; ``slots`` (fruit's index to slot) grows by the fruit it adds.

        The contour's dual conic is W - c c' with W the inverse shape (Hartley and Zisserman 2003, eq. 8.5); its
        tangents along the axes bound the box.
        """
        rotation = eye_from_row[:3, :3]
        centre = self.centre_m @ rotation.T + eye_from_row[:3, 3]
        near = np.flatnonzero(rays.may_see(centre, self.radius_m) & (centre[:, 2] > _NEAREST_M))
        centre = centre[near]
        shape = rotation @ self.shape[near] @ rotation.T
        conic = np.linalg.inv(shape) - centre[:, :, None] * centre[:, None, :]
        w = conic[:, 2, 2, None]  # below 0: the eye's plane stands outside the fruit
        cross = conic[:, :2, 2]
        root = np.sqrt(np.maximum(cross**2 - np.stack([conic[:, 0, 0], conic[:, 1, 1]], axis=1) * w, 0.0))
        first, last = (cross + root) / w, (cross - root) / w
        rim = np.stack([first, 0.5 * (first + last), last], axis=1)
        points = np.stack([rim[:, _NINE_U, 0], rim[:, _NINE_V, 1]], axis=-1)
        pixels = rays.eye.pixels(points.reshape(-1, 2)).reshape(-1, 9, 2)
        boxes = rays.boxes(pixels.min(axis=1), pixels.max(axis=1), 1.5)
        seen = np.flatnonzero((w[:, 0] < 0.0) & (boxes[:, 0] < boxes[:, 2]) & (boxes[:, 1] < boxes[:, 3]))
        for index in near[seen].tolist():
            if len(slots) < SLOTS:
                slots.setdefault(index, len(slots) + 1)
        seen = seen[np.isin(near[seen], list(slots))]
        centre, shape, boxes = centre[seen], shape[seen], boxes[seen]
        nodes = rays.at_nodes(boxes)
        per_pixel = rays.per_pixel(pixels[seen, 4])
        forms, disc_form = _forms(nodes, centre, shape, per_pixel)
        # F is all but quadratic in the image: its slope is linear and 0 in the ellipse's middle
        slope = (2.0 * per_pixel.transpose(0, 2, 1) @ disc_form[:, :2, :2] @ per_pixel).astype(np.float32)
        middle = _middle(rays, disc_form) - boxes[:, :2].astype(np.float32)
        grid = rays.over_grid(nodes, _SHADING_GRID)
        return _Seen(near[seen], centre, shape, boxes, grid, forms, slope, middle)


def _forms(nodes: Array, centre: Array, shape: Array, per_pixel: Array) -> tuple[Array, Array]:
    """At the nodes (m, 4, k, k) the discriminant F of ray against spheroid, the terms a and b of its quadratic and the
    square of F's change per pixel; F's form (m, 3, 3). ``nodes`` (m, 2, k, k) rays, ``per_pixel`` (m, 2, 2) their
    change."""
    count, _, size, _ = nodes.shape
    ray = np.ones((count, 3, size * size))
    ray[:, :2] = nodes.reshape(count, 2, size * size)
    pull = (shape @ centre[..., None])[..., 0]
    outside = np.einsum("mi,mi->m", centre, pull) - 1.0
    disc_form = pull[:, :, None] * pull[:, None, :] - outside[:, None, None] * shape
    bent = disc_form @ ray
    out = np.empty((count, 4, size * size))
    out[:, 0] = np.einsum("mip,mip->mp", bent, ray)
    out[:, 1] = np.einsum("mip,mip->mp", shape @ ray, ray)
    out[:, 2] = np.einsum("mi,mip->mp", pull, ray)
    out[:, 3] = np.sum((2.0 * per_pixel.transpose(0, 2, 1) @ bent[:, :2]) ** 2, axis=1)
    return out.reshape(count, 4, size, size), disc_form


def _middle(rays: Rays, disc_form: Array) -> Floats:
    """(m, 2) pixels of the middles of the contours' ellipses."""
    ray = np.linalg.solve(disc_form[:, :2, :2], -disc_form[:, :2, 2:])[..., 0]
    return rays.eye.pixels(ray).astype(np.float32)


def _sights(rays: Rays, seen: _Seen, codes: Picture, slots: dict[int, int]) -> list[FruitSight]:
    """The contour is where F = 0, and F over F's change per pixel is the distance to it in pixels."""
    if len(seen.index) == 0:
        return []
    boxes: list[Box] = [(box[0], box[1], box[2], box[3]) for box in seen.boxes.tolist()]
    inside, inverse_depths, colours, rims = [], [], [], []
    for k, box in enumerate(boxes):
        size = (box[2] - box[0], box[3] - box[1])
        disc, a, b, change2 = rays.over_box(seen.forms[k], box)
        inside_px = disc / cv2.sqrt(change2)
        inverse_depths.append(a / (b - cv2.sqrt(np.maximum(disc, np.float32(0.0)))))
        colours.append(cv2.resize(codes[k], size, interpolation=cv2.INTER_LINEAR))
        inside.append(inside_px)
        rims.append(np.flatnonzero(np.abs(inside_px) < _EDGE_PX))
    counts = [len(rim) for rim in rims]
    owner = np.repeat(np.arange(len(boxes)), counts)
    rows, columns = np.divmod(np.concatenate(rims), (seen.boxes[:, 2] - seen.boxes[:, 0])[owner])
    away = np.column_stack([columns, rows]).astype(np.float32) - seen.middle[owner]
    distance = np.concatenate([inside_px.ravel()[rim] for inside_px, rim in zip(inside, rims, strict=True)])
    part = np.empty((len(owner), 4), np.float32)
    part[:, :3] = _covered(distance, np.einsum("nij,nj->in", seen.slope[owner], away))[:, None]
    part[:, 3] = distance >= 0.0
    own = np.concatenate([colour.reshape(-1, 4)[rim] for colour, rim in zip(colours, rims, strict=True)])
    ink = own.astype(np.float32)
    ink *= ink
    ink *= part
    cuts = np.cumsum(counts).tolist()
    some = [slice(cut - count, cut) for cut, count in zip(cuts, counts, strict=True)]
    depths, indices = seen.centre[:, 2].tolist(), seen.index.tolist()
    return [
        FruitSight(
            index=indices[k],
            slot=slots[indices[k]],
            depth_m=depths[k],
            box=box,
            colour=colours[k],
            inverse_depth=inverse_depths[k],
            within=inside[k] >= 0.0,
            whole=inside[k] >= _EDGE_PX,
            rim=(rows[some[k]], columns[some[k]]),
            part=part[some[k]],
            ink=ink[some[k]],
        )
        for k, box in enumerate(boxes)
    ]


def draw_fruit(canvas: Canvas, view: FruitSight) -> None:
    """Paint one fruit; colours mix by covered area in linear light."""
    x0, y0, x1, y1 = view.box
    behind = canvas.inverse_depth[y0:y1, x0:x1]
    under = canvas.picture[y0:y1, x0:x1]
    free = view.inverse_depth > behind
    mixed = under[view.rim].astype(np.float32)
    mixed *= mixed
    mixed += free[view.rim][:, None] * (view.ink - view.part * mixed)
    np.sqrt(mixed, out=mixed)
    cv2.copyTo(view.colour, (view.whole & free).view(np.uint8), under)
    under[view.rim] = (mixed + np.float32(0.5)).astype(np.uint8)
    cv2.copyTo(view.inverse_depth, (view.within & free).view(np.uint8), behind)


def _covered(inside_px: Floats, slope: Floats) -> Floats:
    """(n,) area of a unit square on the inner side of a straight edge, its middle ``inside_px`` within; the edge's
    normal is along ``slope`` (2, n). The profile is a box of width |normal u| drawn through one of width |normal v|."""
    p, q = np.abs(slope) / np.sqrt(slope[0] * slope[0] + slope[1] * slope[1])
    long, short = np.maximum(p, q), np.maximum(np.minimum(p, q), np.float32(1e-4))
    away = np.abs(inside_px)
    corner = np.maximum(0.5 * (long + short) - away, 0.0)
    part = np.where(away <= 0.5 * (long - short), 0.5 + away / long, 1.0 - corner * corner / (2.0 * long * short))
    return np.asarray(np.where(inside_px >= 0.0, part, 1.0 - part), dtype=np.float32)

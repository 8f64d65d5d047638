"""Fruit into a canvas: every pixel's ray against the spheroid, edges by covered area."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from drivers.twin.canvas import Box, Canvas, Floats, Picture, Rays
from drivers.twin.fruit_shading import FruitSkins, shade_fruits
from drivers.twin.illumination import Illumination
from drivers.twin.solids import TwinFruit
from drivers.twin.sunlight import Sunlight

Array = npt.NDArray[np.float64]

_NEAREST_M = 0.15
_EDGE_PX = 0.7072  # half the diagonal of a pixel
_SHADING_GRID = 22
_NINE_U, _NINE_V = (grid.ravel() for grid in np.meshgrid(np.arange(3), np.arange(3)))


@dataclass(frozen=True, slots=True, eq=False)
class FruitSight:
    """A fruit before one eye. ``forms`` (4, k, k) at the nodes of its box: the discriminant F of ray against spheroid,
    the terms a and b of its quadratic, the square of F's change per pixel; ``slope`` (2, 2) that change's own per pixel
    along u and v, and ``middle`` (2,) where it is 0. ``codes`` (g, g, 4) colours its box."""

    index: int
    depth_m: float
    box: Box
    forms: Array
    slope: Floats
    middle: Floats
    codes: Picture


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
        self, rays: Rays, eye_from_row: Array, lamp_m: Array, light: Illumination, sun: Sunlight
    ) -> list[FruitSight]:
        """The fruit an eye may see, lit, with tight boxes.

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
        if len(seen) == 0:
            return []
        centre, shape, boxes, chosen = centre[seen], shape[seen], boxes[seen], near[seen]
        nodes = rays.at_nodes(boxes)
        per_pixel = rays.per_pixel(pixels[seen, 4])
        forms, disc_form = _forms(nodes, centre, shape, per_pixel)
        # F is all but quadratic in the image: its slope is linear and 0 in the ellipse's middle
        slope = (2.0 * per_pixel.transpose(0, 2, 1) @ disc_form[:, :2, :2] @ per_pixel).astype(np.float32)
        middle = _middle(rays, disc_form) - boxes[:, :2]
        grid = rays.over_grid(nodes, _SHADING_GRID)
        codes = shade_fruits(self.skins, chosen, grid, centre, shape, eye_from_row, lamp_m, light, sun)
        depths, indices = centre[:, 2].tolist(), chosen.tolist()
        return [
            FruitSight(indices[k], depths[k], (box[0], box[1], box[2], box[3]), forms[k], slope[k], middle[k], codes[k])
            for k, box in enumerate(boxes.tolist())
        ]


def _forms(nodes: Array, centre: Array, shape: Array, per_pixel: Array) -> tuple[Array, Array]:
    """(m, 4, k, k) and F's form (m, 3, 3); ``nodes`` (m, 2, k, k) rays, ``per_pixel`` (m, 2, 2) their change."""
    count, _, size, _ = nodes.shape
    ray = np.ones((count, 3, size * size))
    ray[:, :2] = nodes.reshape(count, 2, -1)
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


def draw_fruit(canvas: Canvas, rays: Rays, view: FruitSight, slot: int) -> None:
    """Paint one fruit: its contour is where F = 0, and F over F's change per pixel is the distance to it in pixels.
    Colours mix by covered area in linear light."""
    x0, y0, x1, y1 = view.box
    disc, a, b, change2 = rays.over_box(view.forms, view.box)
    inside_px = disc / cv2.sqrt(change2)
    inverse_depth = a / (b - cv2.sqrt(np.maximum(disc, np.float32(0.0))))
    behind = canvas.inverse_depth[y0:y1, x0:x1]
    under = canvas.picture[y0:y1, x0:x1]
    view.codes[..., 3] = slot
    colour = cv2.resize(view.codes, (x1 - x0, y1 - y0), interpolation=cv2.INTER_LINEAR)
    free = inverse_depth > behind
    whole = (inside_px >= _EDGE_PX) & free
    edge = np.flatnonzero((inside_px > -_EDGE_PX) & free & ~whole)
    v, u = np.divmod(edge, x1 - x0)
    distance = inside_px.ravel()[edge]
    away = np.stack([u - view.middle[0], v - view.middle[1]], axis=0).astype(np.float32)
    part = _covered(distance, view.slope @ away)[:, None]
    new, old = colour.reshape(-1, 4)[edge].astype(np.float32), under[v, u].astype(np.float32)
    mixed = np.sqrt(part * (new * new) + (1.0 - part) * (old * old)) + np.float32(0.5)
    mixed[:, 3] = np.where(distance >= 0.0, slot, old[:, 3])
    cv2.copyTo(colour, whole.view(np.uint8), under)
    under[v, u] = mixed.astype(np.uint8)
    cv2.copyTo(inverse_depth, ((inside_px >= 0.0) & free).view(np.uint8), behind)


def _covered(inside_px: Floats, slope: Floats) -> Floats:
    """(n,) area of a unit square on the inner side of a straight edge, its middle ``inside_px`` within; the edge's
    normal is along ``slope`` (2, n). The profile is a box of width |normal u| drawn through one of width |normal v|."""
    p, q = np.abs(slope) / np.sqrt(slope[0] * slope[0] + slope[1] * slope[1])
    long, short = np.maximum(p, q), np.maximum(np.minimum(p, q), np.float32(1e-4))
    away = np.abs(inside_px)
    corner = np.maximum(0.5 * (long + short) - away, 0.0)
    part = np.where(away <= 0.5 * (long - short), 0.5 + away / long, 1.0 - corner * corner / (2.0 * long * short))
    return np.asarray(np.where(inside_px >= 0.0, part, 1.0 - part), dtype=np.float32)

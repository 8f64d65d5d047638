"""How the true rig sees each fruit: what the pictures are judged by."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from drivers.twin.canvas import Rays
from drivers.twin.optics import Eye
from drivers.twin.solids import TwinFruit

Array = npt.NDArray[np.float64]

_OUTLINE_POINTS = 72


@dataclass(frozen=True, slots=True, eq=False)
class EyeView:
    """One fruit in one eye. ``visible_fraction`` is the share of its whole outline that shows; what lies outside the
    image counts as hidden. ``bbox`` (x0, y0, x1, y1) and ``area_px2`` are of the whole outline with nothing before it.

    ``centre_px`` (2,) is the projection of the fruit's centre, nan behind the camera.
    """

    centre_px: Array
    visible_fraction: float
    in_image_fraction: float
    bbox: tuple[float, float, float, float]
    area_px2: float


@dataclass(frozen=True, slots=True, eq=False)
class FruitView:
    """One fruit before the true rig: its centre (3,) in the left optical frame, and how each eye sees it."""

    id: int
    centre_m: Array
    left: EyeView
    right: EyeView

    @property
    def visible_fraction(self) -> float:
        """The smaller of both eyes' fractions."""
        return min(self.left.visible_fraction, self.right.visible_fraction)


def eye_view(fruit: TwinFruit, rays: Rays, eye_from_row: Array, shown_px: int) -> EyeView:
    """A fruit in an eye in which ``shown_px`` pixels of it show."""
    centre = eye_from_row[:3, :3] @ fruit.centre_m + eye_from_row[:3, 3]
    ahead = centre[2] > 1e-6
    pixel = rays.eye.pixels(centre[:2] / centre[2])[0] if ahead else np.full(2, np.nan)
    outline = outline_px(fruit, rays.eye, eye_from_row)
    if outline is None:
        return EyeView(pixel, 0.0, 0.0, (0.0, 0.0, 0.0, 0.0), 0.0)
    area = _area(outline)
    right, bottom = rays.width - 0.5, rays.height - 0.5
    frame = np.array([[-0.5, -0.5], [right, -0.5], [right, bottom], [-0.5, bottom]], np.float32)
    inside, _ = cv2.intersectConvexConvex(cv2.convexHull(outline.astype(np.float32)), frame)
    low, high = outline.min(axis=0), outline.max(axis=0)
    return EyeView(
        centre_px=pixel,
        visible_fraction=min(shown_px / area, 1.0),
        in_image_fraction=min(max(float(inside), 0.0) / area, 1.0),
        bbox=(float(low[0]), float(low[1]), float(high[0]), float(high[1])),
        area_px2=area,
    )


def outline_px(fruit: TwinFruit, eye: Eye, eye_from_row: Array, points: int = _OUTLINE_POINTS) -> Array | None:
    """(n, 2) pixels of the contour of a fruit, exact on its spheroid; None when it is not wholly before the eye."""
    rotation = eye_from_row[:3, :3]
    centre = rotation @ fruit.centre_m + eye_from_row[:3, 3]
    if centre[2] < fruit.semi_equatorial_m + 0.05:
        return None
    root = np.linalg.cholesky(rotation @ fruit.shape() @ rotation.T)
    seen_from = -root.T @ centre  # in the space where the spheroid is the unit ball
    distance2 = float(seen_from @ seen_from)
    pole = seen_from / np.sqrt(distance2)
    helper = np.array([1.0, 0.0, 0.0]) if abs(pole[0]) < 0.7 else np.array([0.0, 1.0, 0.0])
    first = np.cross(pole, helper)
    first /= np.linalg.norm(first)
    second = np.cross(pole, first)
    turn = np.linspace(0.0, 2.0 * np.pi, points, endpoint=False)[:, None]
    rim = seen_from / distance2 + np.sqrt(1.0 - 1.0 / distance2) * (np.cos(turn) * first + np.sin(turn) * second)
    contour = centre + np.linalg.solve(root.T, rim.T).T
    return eye.pixels(contour[:, :2] / contour[:, 2:])


def _area(polygon: Array) -> float:
    """Area (shoelace) of an outline sampled at even angles, with the share the chords cut off put back."""
    x, y = polygon[:, 0], polygon[:, 1]
    chords = 0.5 * abs(float(x @ np.roll(y, -1) - y @ np.roll(x, -1)))
    turn = 2.0 * np.pi / len(polygon)
    return chords * turn / float(np.sin(turn))

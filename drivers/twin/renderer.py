"""The twin's stereo camera: pictures with exact ground truth."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from functools import partial
from typing import Protocol

import numpy as np
import numpy.typing as npt

from drivers.twin.backdrop import Backdrop
from drivers.twin.canvas import Canvas, Picture, Rays
from drivers.twin.draw_capsules import CapsuleSet, CapsuleView, draw_capsule
from drivers.twin.draw_fruits import FruitSet, FruitSight, draw_fruit
from drivers.twin.draw_leaves import LeafSet, LeafView, LitLeaves, draw_leaf
from drivers.twin.illumination import Illumination
from drivers.twin.light import Light, light_at
from drivers.twin.optics import StereoOptics
from drivers.twin.sensor import Sensor
from drivers.twin.sightings import EyeView, FruitView, eye_view
from drivers.twin.solids import Capsule, Greenhouse
from drivers.twin.sunlight import Sunlight, sunlight

__all__ = ["DEFAULT_EXPOSURE_S", "Capsule", "EyeView", "FruitView", "StereoRenderer"]

Array = npt.NDArray[np.float64]

DEFAULT_EXPOSURE_S = 0.004


@dataclass(frozen=True, slots=True, eq=False)
class _Lit:
    """A greenhouse in one light: what is the same for every picture taken in it."""

    light: Light
    illumination: Illumination
    backdrop: Picture
    leaves: LitLeaves
    sun: Sunlight


@dataclass(frozen=True, slots=True, eq=False)
class _Painted:
    """Both eyes' pictures before the sensor, and which fruit (index) each slot in them stands for."""

    key: tuple[object, ...]
    eyes_from_row: tuple[Array, Array]
    canvases: tuple[Canvas, Canvas]
    slots: dict[int, int]


class PairRenderer(Protocol):
    """What the twin's camera asks; see ``StereoRenderer``."""

    def render(
        self, row_from_camera: npt.ArrayLike, light: Light, exposure_s: float = ..., gain: float = ...,
        arm: Sequence[Capsule] = ..., frame: int = ...,
    ) -> tuple[Picture, Picture]: ...  # fmt: skip

    def truth(self, row_from_camera: npt.ArrayLike, arm: Sequence[Capsule] = ...) -> tuple[FruitView, ...]: ...


class StereoRenderer:
    """Pictures of a greenhouse by a stereo pair; the same seed, pose, light and frame number give the same pictures.

    Keeps what the last light and the last pose have in common with the next picture; that changes no result.
    """

    def __init__(self, greenhouse: Greenhouse, optics: StereoOptics, seed: int) -> None:
        self._greenhouse = greenhouse
        self._rays = (Rays(optics.left, optics.image_size), Rays(optics.right, optics.image_size))
        self._sensor = Sensor(optics.image_size, seed)
        self._backdrop = Backdrop(greenhouse.wall_y_m, greenhouse.seed)
        self._fruits = FruitSet.of(greenhouse.fruits)
        self._leaves = LeafSet.of(greenhouse.leaves)
        self._stems = CapsuleSet.of(greenhouse.stems)
        self._lit: _Lit | None = None
        self._painted: _Painted | None = None

    def render(
        self,
        row_from_camera: npt.ArrayLike,
        light: Light,
        exposure_s: float = DEFAULT_EXPOSURE_S,
        gain: float = 1.0,
        arm: Sequence[Capsule] = (),
        frame: int = 0,
        *,
        noise: bool = True,
    ) -> tuple[Picture, Picture]:
        """Left and right (h, w, 3) BGR, 8 bit sRGB, from the left camera's pose (4, 4) (optical frame to row frame).

        Nothing moves during the exposure. The first picture in a new light also works out its shadows.
        ``ValueError`` for a pose that is not a rigid (4, 4), an exposure not above 0 or a gain below 1.
        """
        if not (math.isfinite(exposure_s) and exposure_s > 0.0):
            raise ValueError(f"exposure_s: expected above 0, found {exposure_s:g}; give seconds")
        if not (math.isfinite(gain) and gain >= 1.0):
            raise ValueError(f"gain: expected 1 or more, found {gain:g}; give the linear gain")
        lit = self._in_light(light)
        painted = self._paint(_pose(row_from_camera), lit, arm)
        left, right = (
            self._sensor.expose(
                canvas.picture, lit.illumination.full_scale, exposure_s, gain, frame, eye, noise=noise
            )
            for eye, canvas in enumerate(painted.canvases)
        )
        return left, right

    def truth(self, row_from_camera: npt.ArrayLike, arm: Sequence[Capsule] = ()) -> tuple[FruitView, ...]:
        """Every fruit that may be in an image of the pair, by the z-buffer of the very same picture."""
        pose = _pose(row_from_camera)
        lit = self._lit if self._lit is not None else self._in_light(light_at(12.0))
        painted = self._paint(pose, lit, arm)
        counts = [canvas.shown() for canvas in painted.canvases]
        views = []
        for slot, index in painted.slots.items():
            fruit = self._greenhouse.fruits[index]
            left, right = (
                eye_view(fruit, rays, eye_from_row, int(count[slot]))
                for rays, eye_from_row, count in zip(self._rays, painted.eyes_from_row, counts, strict=True)
            )
            left_from_row = painted.eyes_from_row[0]
            centre_m = left_from_row[:3, :3] @ fruit.centre_m + left_from_row[:3, 3]
            views.append(FruitView(fruit.id, centre_m, left, right))
        return tuple(views)

    def _in_light(self, light: Light) -> _Lit:
        if self._lit is None or not _same_light(self._lit.light, light):
            illumination = Illumination.of(light)
            plants, direction = self._greenhouse, light.sun_direction
            if self._lit is not None and np.array_equal(self._lit.light.sun_direction, direction):
                sun = self._lit.sun
            else:
                sun = sunlight(plants, direction)
            self._lit = _Lit(
                light=light,
                illumination=illumination,
                backdrop=self._backdrop.lit(illumination),
                leaves=LitLeaves(plants.leaves, illumination, sun.leaves),
                sun=sun,
            )
        return self._lit

    def _paint(self, row_from_left: Array, lit: _Lit, arm: Sequence[Capsule]) -> _Painted:
        key = (id(lit), row_from_left.tobytes(), *(_capsule_key(capsule) for capsule in arm))
        if self._painted is not None and self._painted.key == key:
            return self._painted
        left_from_row = _inverse(row_from_left)
        right_eye = self._rays[1].eye
        right_from_left = np.eye(4)
        right_from_left[:3, :3], right_from_left[:3, 3] = right_eye.R, right_eye.t_m
        eyes_from_row = (left_from_row, right_from_left @ left_from_row)
        lamp_m = row_from_left[:3, :3] @ (0.5 * right_eye.centre_m) + row_from_left[:3, 3]
        light = lit.illumination
        leaves = self._leaves.views(self._rays, eyes_from_row, lamp_m, lit.leaves)
        stems = self._stems.views(self._rays, eyes_from_row, lamp_m, light)
        solids = CapsuleSet.of(arm).views(self._rays, eyes_from_row, lamp_m, light)
        fruits = self._fruits.views(self._rays, eyes_from_row, lamp_m, light, lit.sun)
        left, right = (
            self._paint_eye(rays, eyes_from_row[eye], lit, leaves[eye], [*stems[eye], *solids[eye]], fruits[eye])
            for eye, rays in enumerate(self._rays)
        )
        slots = {sight.slot: sight.index for seen in fruits for sight in seen}
        self._painted = _Painted(key, eyes_from_row, (left, right), slots)
        return self._painted

    def _paint_eye(
        self,
        rays: Rays,
        eye_from_row: Array,
        lit: _Lit,
        leaves: list[LeafView],
        capsules: list[CapsuleView],
        fruits: list[FruitSight],
    ) -> Canvas:
        """Everything far to near."""
        canvas = Canvas(self._backdrop.seen(lit.backdrop, rays, eye_from_row))
        strokes: list[tuple[float, Callable[[], None]]] = []
        for leaf in leaves:
            strokes.append((leaf.depth_m, partial(draw_leaf, canvas, lit.leaves, leaf)))
        for capsule in capsules:
            strokes.append((capsule.depth_m, partial(draw_capsule, canvas, capsule)))
        for sight in fruits:
            strokes.append((sight.depth_m, partial(draw_fruit, canvas, sight)))
        for _, paint_stroke in sorted(strokes, key=lambda stroke: -stroke[0]):
            paint_stroke()
        return canvas


def _pose(row_from_camera: npt.ArrayLike) -> Array:
    pose = np.asarray(row_from_camera, dtype=np.float64)
    if pose.shape != (4, 4):
        raise ValueError(f"row_from_camera: expected shape (4, 4), found {pose.shape}; give a homogeneous transform")
    if not np.allclose(pose[:3, :3] @ pose[:3, :3].T, np.eye(3), atol=1e-6):
        raise ValueError("row_from_camera: expected a rigid transform, found a rotation part that is none; correct it")
    return pose


def _inverse(rigid: Array) -> Array:
    out = np.eye(4)
    out[:3, :3] = rigid[:3, :3].T
    out[:3, 3] = -rigid[:3, :3].T @ rigid[:3, 3]
    return out


def _capsule_key(capsule: Capsule) -> tuple[object, ...]:
    return capsule.p0_m.tobytes(), capsule.p1_m.tobytes(), capsule.radius_m, capsule.colour


def _same_light(one: Light, other: Light) -> bool:
    return np.array_equal(one.sun_direction, other.sun_direction) and all(
        getattr(one, field.name) == getattr(other, field.name) for field in fields(one) if field.name != "sun_direction"
    )

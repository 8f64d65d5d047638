"""The colours of fruit in their light: all the fruit before the eyes at once."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from drivers.twin.canvas import Floats, Picture
from drivers.twin.illumination import Illumination
from drivers.twin.light import LAMP_REFERENCE_M
from drivers.twin.skin import CALYX_BGR, CalyxAtlas
from drivers.twin.solids import TwinFruit
from drivers.twin.sunlight import GRID, Sunlight, close_neighbours

Array = npt.NDArray[np.float64]

_GLOSS = 0.4  # peak of the highlight, over the radiance of white
_CONTACT_SHADE = 0.7


@dataclass(frozen=True, slots=True, eq=False)
class FruitSkins:
    """What the skin of fruit depends on, by arrays in the row frame: ``frame`` (m, 3, 3) has the rows axis and two
    across it, ``skin`` (m, 3, 3) the columns flank, shoulder less flank and calyx."""

    radius_m: Array
    polar_m: Array
    frame: Array
    neighbours: Array
    skin: Floats
    calyx: CalyxAtlas

    @classmethod
    def of(cls, fruits: tuple[TwinFruit, ...]) -> FruitSkins:
        flank = np.array([fruit.colour[::-1] for fruit in fruits]).reshape(-1, 3)
        shoulder = np.array([fruit.shoulder[::-1] for fruit in fruits]).reshape(-1, 3)
        skin = np.stack([flank, shoulder - flank, np.broadcast_to(CALYX_BGR, flank.shape)], axis=-1)
        return cls(
            np.array([fruit.semi_equatorial_m for fruit in fruits]),
            np.array([fruit.semi_polar_m for fruit in fruits]),
            np.array([_frame(fruit.axis) for fruit in fruits]).reshape(-1, 3, 3),
            close_neighbours(fruits),
            skin.astype(np.float32),
            CalyxAtlas(),
        )


def shade_fruits(
    skins: FruitSkins,
    chosen: npt.NDArray[np.int64],
    rays: Floats,
    centre: Array,
    shape: Array,
    eyes_from_row: Array,
    lamp_m: Array,
    light: Illumination,
    sun: Sunlight,
) -> Picture:
    """(m, g, g, 4) codes over the boxes of the chosen fruit, the last channel 0.

    ``rays`` (m, 2, g, g) over the boxes, ``centre`` (m, 3) and ``shape`` (m, 3, 3) in the frame of the eye of each,
    ``eyes_from_row`` (m, 4, 4). Lambert's law for sun, sky and lamp, a highlight, shadows of leaves and of touching
    fruit, the calyx and the shoulder's colour.
    """
    rotation = eyes_from_row[:, :3, :3]
    back = rotation.transpose(0, 2, 1)
    count, _, grid, _ = rays.shape
    ray = np.ones((count, 3, grid * grid), np.float32)
    ray[:, :2] = rays.reshape(count, 2, -1)
    bent = shape.astype(np.float32) @ ray
    pull = (shape @ centre[..., None]).astype(np.float32)
    outside = np.einsum("mi,mi->m", centre, pull[..., 0]).astype(np.float32) - 1.0
    a = np.einsum("mip,mip->mp", bent, ray)
    b = (pull.transpose(0, 2, 1) @ ray)[:, 0]
    depth = ((b - np.sqrt(np.maximum(b * b - outside[:, None] * a, 0.0))) / a)[:, None]
    normal = bent * depth - pull
    normal /= np.sqrt(np.einsum("mip,mip->mp", normal, normal))[:, None]
    axes = np.concatenate(
        [
            skins.frame[chosen] @ back,
            np.stack([sun.right, sun.up]) @ back,
        ],
        axis=1,
    )
    place = (axes.astype(np.float32) @ ray) * depth - (axes @ centre[..., None]).astype(np.float32)
    place /= skins.radius_m[chosen].astype(np.float32)[:, None, None]
    looks, lamp_gain = _looks(centre, eyes_from_row, lamp_m, light)
    up, to_sun, shine_sun, to_lamp, shine_lamp, *near = np.moveaxis(
        np.concatenate([looks, (skins.neighbours[chosen] @ back).astype(np.float32)], axis=1) @ normal, 1, 0
    )
    lit = _sunlit(sun.fruits[chosen], place[:, 3], place[:, 4]) * np.maximum(to_sun, 0.0)
    shade = np.ones_like(lit)
    for facing in near:
        facing = np.maximum(facing, 0.0)
        shade *= 1.0 - np.float32(_CONTACT_SHADE) * facing * facing * facing
    star = skins.calyx.over(chosen, place[:, :3])
    bare = 1.0 - star
    squeeze = (1.8 * skins.radius_m / skins.polar_m)[chosen].astype(np.float32)[:, None]
    top = np.clip(place[:, 0] * squeeze - np.float32(0.63), 0.0, 1.0)
    level, overhead = light.ambient(np.array([0.0, 1.0]))
    scale = 1.0 / (np.pi * light.full_scale)
    lamp = light.lamp * lamp_gain[:, None]
    sunshine = np.broadcast_to(light.sun, (count, 3))
    sky = np.broadcast_to(level, (count, 3)), np.broadcast_to(overhead - level, (count, 3))
    lights = (scale * np.stack([sunshine, *sky, lamp], axis=-1)).astype(np.float32)
    mirror = (scale * _GLOSS * np.stack([sunshine, lamp], axis=-1)).astype(np.float32)
    albedo = skins.skin[chosen] @ np.stack([bare, top * bare, star], axis=1)
    irradiance = lights @ np.stack([lit, shade, up * shade, np.maximum(to_lamp, 0.0)], axis=1)
    shine = np.stack([_power32(shine_sun) * lit, _power32(shine_lamp)], axis=1) * bare[:, None]
    radiance = albedo * irradiance + mirror @ shine
    np.sqrt(radiance, out=radiance)
    codes = np.minimum(radiance * np.float32(255.0) + np.float32(0.5), np.float32(255.0))
    out = np.zeros((count, grid, grid, 4), np.uint8)
    out[..., :3] = codes.reshape(count, 3, grid, grid).transpose(0, 2, 3, 1)
    return out


def _sunlit(maps: Floats, right: Floats, up: Floats) -> Floats:
    """(m, p) shadow maps (m, g, g) at places (m, p) in -1..1."""
    count = len(maps)
    half, middle = np.float32(0.5 * GRID), np.float32(0.5 * GRID - 0.5)
    u = np.clip(right * half + middle, 0.0, GRID - 1.0)
    v = np.clip(up * half + middle, 0.0, GRID - 1.0)
    v += (np.arange(count, dtype=np.float32) * GRID)[:, None]
    return np.asarray(cv2.remap(maps.reshape(count * GRID, GRID), u, v, cv2.INTER_LINEAR), dtype=np.float32)


def _looks(centre: Array, eyes_from_row: Array, lamp_m: Array, light: Illumination) -> tuple[Floats, Array]:
    """(m, 5, 3) unit vectors up, to sun, halfway eye and sun, to lamp, halfway eye and lamp; (m,) (0.6 m / d)2."""
    rotation = eyes_from_row[:, :3, :3]
    to_eye = _unit(-centre)
    to_lamp = rotation @ lamp_m + eyes_from_row[:, :3, 3] - centre
    gain = LAMP_REFERENCE_M**2 / np.einsum("ni,ni->n", to_lamp, to_lamp)
    to_lamp = _unit(to_lamp)
    sun = rotation @ light.sun_direction
    looks = np.stack(
        [
            rotation[:, :, 2],
            sun,
            _unit(to_eye + sun),
            to_lamp,
            _unit(to_eye + to_lamp),
        ],
        axis=1,
    )
    return looks.astype(np.float32), gain


def _power32(base: Floats) -> Floats:
    out = np.maximum(base, 0.0)
    for _ in range(5):
        out *= out
    return np.asarray(out)


def _unit(vectors: Array) -> Array:
    return np.asarray(vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-9))


def _frame(axis: Array) -> Array:
    helper = np.array([1.0, 0.0, 0.0]) if abs(axis[0]) < 0.7 else np.array([0.0, 1.0, 0.0])
    first = _unit(np.cross(axis, helper))
    return np.stack([axis, first, np.cross(axis, first)])

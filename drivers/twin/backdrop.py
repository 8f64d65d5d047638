"""Soil and far wall with the next row before it: one picture, unrolled over the fold where they meet."""

from __future__ import annotations

import math

import cv2
import numpy as np
import numpy.typing as npt

from drivers.twin.canvas import GRID_PX, Floats, Picture, Rays
from drivers.twin.illumination import Illumination
from drivers.twin.leaf_pictures import PAIRS, TERMINALS, leaf_picture

Array = npt.NDArray[np.float64]

PX_PER_M = 150.0
PERIOD_M = 4.8  # along the row, then the picture comes again
WALL_M = 2.7
_FARTHEST_M = 12.0
_SEED = 9001


class Backdrop:
    """The picture along x (columns, repeating) and along the unrolled height (rows): wall down to 0, then soil."""

    def __init__(self, wall_y_m: float, seed: int) -> None:
        self._wall_y_m = wall_y_m
        self._soil_rows = round(abs(wall_y_m) * PX_PER_M)
        self._wall_rows = round(WALL_M * PX_PER_M)
        rng = np.random.default_rng([_SEED, seed])
        self._reflectance = np.vstack([_wall(self._wall_rows, rng), _soil(self._soil_rows, rng)])

    def lit(self, light: Illumination) -> Picture:
        """(rows, columns, 4) codes of radiance, the last channel 0."""
        facing = max(-math.copysign(1.0, self._wall_y_m) * float(light.sun_direction[1]), 0.0)
        high = max(float(light.sun_direction[2]), 0.0)
        depth = np.array([abs(self._wall_y_m)])
        lamp = light.lamp_at(depth)[0]
        through = 0.12 * light.sun * max(math.copysign(1.0, self._wall_y_m) * float(light.sun_direction[1]), 0.0)
        wall = 0.6 * facing * light.sun + 0.35 * light.sky + light.bounce + through + lamp
        soil = 0.45 * high * light.sun + 0.5 * light.sky + 0.3 * lamp
        out = self._reflectance.copy()
        for rows, irradiance in ((slice(0, self._wall_rows), wall), (slice(self._wall_rows, None), soil)):
            table = np.minimum(np.arange(256)[:, None] * light.gain(irradiance) + 0.5, 255.0).astype(np.uint8)
            out[rows] = cv2.LUT(out[rows], table[:, None, :])
        empty = np.zeros((*out.shape[:2], 1), np.uint8)
        return np.concatenate([out, empty], axis=2)

    def seen(self, lit: Picture, rays: Rays, eye_from_row: Array) -> Picture:
        """(h, w, 4) what an eye sees of it. Half resolution, as a lens focused on the near row renders it."""
        width, height = rays.width, rays.height
        columns, rows = rays.grid.shape[1::-1]
        rotation = eye_from_row[:3, :3]
        directions = rotation.T @ rays.grid.reshape(-1, 3).T
        origin = -rotation.T @ eye_from_row[:3, 3]
        maps = self._places(origin, directions).reshape(rows, columns, 2)
        factor = GRID_PX // 2
        fine = cv2.resize(maps, (columns * factor, rows * factor), interpolation=cv2.INTER_LINEAR)
        fine = fine[factor : factor + (height + 1) // 2, factor : factor + (width + 1) // 2]
        x, y = cv2.split(fine)
        half = cv2.remap(lit, x, y, cv2.INTER_NEAREST, borderMode=cv2.BORDER_WRAP)
        return np.asarray(cv2.resize(half, (width, height), interpolation=cv2.INTER_LINEAR), dtype=np.uint8)

    def _places(self, origin: Array, directions: Array) -> Floats:
        """(n, 2) columns and rows of the picture that rays (3, n) meet."""
        with np.errstate(divide="ignore", invalid="ignore"):
            to_wall = (self._wall_y_m - origin[1]) / directions[1]
            to_soil = -origin[2] / directions[2]
        to_wall[~(to_wall > 0.0)] = _FARTHEST_M
        to_soil[~(to_soil > 0.0)] = _FARTHEST_M
        reach = np.minimum(np.minimum(to_wall, to_soil), _FARTHEST_M)
        turn = math.floor(origin[0] / PERIOD_M) * PERIOD_M
        along_m = origin[0] - turn + reach * directions[0]
        away_m = math.copysign(1.0, self._wall_y_m) * (origin[1] + reach * directions[1])
        short_of_wall = np.maximum(abs(self._wall_y_m) - away_m, 0.0)
        down_m = WALL_M + np.where(to_soil < to_wall, short_of_wall, -origin[2] - reach * directions[2])
        last = self._wall_rows + self._soil_rows - 2
        out = np.empty((len(reach), 2), np.float32)
        out[:, 0] = along_m * PX_PER_M - 0.5
        out[:, 1] = np.minimum(np.maximum(down_m * PX_PER_M - 0.5, 0.0), last)
        return out


def _mottle(shape: tuple[int, int], cell_px: float, rng: np.random.Generator) -> Array:
    """Smooth noise with deviation about 1 that repeats along x."""
    rows, columns = max(2, round(shape[0] / cell_px)), max(2, round(shape[1] / cell_px))
    noise = rng.normal(size=(rows, columns))
    wide = np.concatenate([noise, noise, noise], axis=1)
    grown = cv2.resize(wide, (3 * shape[1], shape[0]), interpolation=cv2.INTER_CUBIC)
    return np.asarray(grown[:, shape[1] : 2 * shape[1]], dtype=np.float64)


def _codes(reflectance: Array) -> Picture:
    return np.round(255.0 * np.sqrt(np.clip(reflectance, 0.0, 1.0))).astype(np.uint8)


def _soil(rows: int, rng: np.random.Generator) -> Picture:
    shape = (rows, round(PERIOD_M * PX_PER_M))
    grain = 1.0 + 0.22 * _mottle(shape, 40, rng) + 0.18 * _mottle(shape, 7, rng) + 0.12 * _mottle(shape, 2, rng)
    return _codes(np.array([0.075, 0.115, 0.175]) * np.clip(grain, 0.25, 2.0)[..., None])


def _wall(rows: int, rng: np.random.Generator) -> Picture:
    """Pale panels and posts, and the next row's plants before them."""
    shape = (rows, round(PERIOD_M * PX_PER_M))
    pale = np.array([0.55, 0.54, 0.50]) * (1.0 + 0.06 * _mottle(shape, 90, rng))[..., None]
    pale[:, :: round(0.6 * PX_PER_M)] *= 0.7
    pale[:: round(0.45 * PX_PER_M)] *= 0.8
    picture = _codes(pale)
    for _ in range(11):  # vines and canes
        x = int(rng.integers(0, shape[1]))
        sway = np.cumsum(rng.normal(0.0, 0.5, rows))
        points = np.column_stack([x + sway, np.arange(rows)]).round().astype(np.int32)
        colour = 255.0 * np.sqrt(np.array([0.05, 0.14, 0.08]) * rng.uniform(0.6, 1.3))
        cv2.polylines(picture, [points], False, tuple(float(c) for c in colour), 2, cv2.LINE_AA)
    for _ in range(520):
        _stamp(picture, rng)
    return picture


def _stamp(picture: Picture, rng: np.random.Generator) -> None:
    """One leaf of the next row, turned and shaded at random; it goes on at the other end of the picture."""
    rows, columns = picture.shape[:2]
    size = int(rng.integers(14, 34))
    leaf = leaf_picture(int(rng.choice(PAIRS + TERMINALS)), 64 if size > 24 else 32)
    angle, squeeze = rng.uniform(0.0, math.tau), rng.uniform(0.35, 1.0)
    c, s, k = math.cos(angle) * size / leaf.shape[0], math.sin(angle) * size / leaf.shape[0], leaf.shape[0] / 2
    matrix = np.array([[c, -s * squeeze, 0.0], [s, c * squeeze, 0.0]])
    matrix[:, 2] = size - matrix[:, :2] @ [k, k]
    stamp = cv2.warpAffine(leaf, matrix, (2 * size, 2 * size))
    row = int(rng.triangular(0, 0.45 * rows, rows)) - size
    at = np.arange(int(rng.integers(0, columns)), columns * 2)[: 2 * size] % columns
    shade = math.sqrt(rng.uniform(0.35, 1.2))
    low, high = max(row, 0), min(row + 2 * size, rows)
    stamp = stamp[low - row : high - row]
    share = stamp[..., 3:].astype(np.float64) / 255.0
    under = picture[low:high, at]
    picture[low:high, at] = (share * np.minimum(stamp[..., :3] * shade, 255.0) + (1.0 - share) * under).astype(np.uint8)

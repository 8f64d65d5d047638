"""The image sensor: blur, electrons, shot and read noise, sRGB codes."""

from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np
import numpy.typing as npt

from drivers.twin.canvas import Floats, Picture

FULL_WELL_E = 9000.0
READ_NOISE_E = 7.0
BLUR_PX = 0.55
ELECTRONS_PER_EXPOSURE = 9000.0 * 2.0  # per W/m2/sr and second
_STEPS_PER_SIGMA = 24.0
_STRIP_ROWS = 24
_POOL_ROWS, _POOL_COLUMNS = 1024, 8192


class Sensor:
    """Turns pictures of radiance into 8 bit sRGB.

    Shot and read noise: with v = 2 sqrt(e + r^2), v plus a unit normal number stands for e electrons with variance
    e + r^2 (Anscombe 1948), so a pool of unit normal numbers, drawn once, serves every level of light.
    """

    def __init__(self, image_size: tuple[int, int], seed: int) -> None:
        width, height = image_size
        self._shape = (height, width)
        self._seed = seed
        needed = max(_POOL_ROWS, height + 64), max(_POOL_COLUMNS, 3 * width + 64)
        rng = np.random.default_rng([seed, 5])
        self._pool: Floats = rng.standard_normal(needed, dtype=np.float32) * np.float32(_STEPS_PER_SIGMA)
        self._pool += np.float32(0.5)  # rounds to nearest when cut to integers

    def expose(
        self, picture: Picture, full_scale: float, exposure_s: float, gain: float, frame: int, eye: int, *, noise: bool
    ) -> Picture:
        """(h, w, 3) BGR. ``picture`` holds codes 255 * sqrt(radiance / full_scale) in its first three channels."""
        electrons = ELECTRONS_PER_EXPOSURE * full_scale * exposure_s * (np.arange(256) / 255.0) ** 2
        table = (2.0 * _STEPS_PER_SIGMA) ** 2 * (np.minimum(electrons, FULL_WELL_E) + READ_NOISE_E**2)
        level = cv2.LUT(cv2.cvtColor(picture, cv2.COLOR_BGRA2BGR), table.astype(np.float32))
        cv2.GaussianBlur(level, (3, 3), BLUR_PX, dst=level)
        flat = level.reshape(level.shape[0], -1)
        grain = self._noise(frame, eye) if noise else None
        codes = _codes(gain, noise)
        out = np.empty(flat.shape, np.uint8)
        for first in range(0, len(flat), _STRIP_ROWS):  # a strip stays in the cache
            rows = slice(first, min(first + _STRIP_ROWS, len(flat)))
            strip = cv2.sqrt(flat[rows])
            strip = cv2.add(strip, grain[rows], dst=strip) if grain is not None else strip + np.float32(0.5)
            np.take(codes, strip.astype(np.intp), out=out[rows], mode="clip")
        return out.reshape(level.shape)

    def _noise(self, frame: int, eye: int) -> Floats:
        """(h, 3 w) unit normal numbers in steps, from a place in the pool that (seed, frame, eye) draw."""
        rng = np.random.default_rng([self._seed, frame, eye])
        height, width = self._shape
        row = int(rng.integers(0, self._pool.shape[0] - height + 1))
        column = int(rng.integers(0, self._pool.shape[1] - 3 * width + 1))
        return self._pool[row : row + height, column : column + 3 * width]


@lru_cache(maxsize=64)
def _codes(gain: float, noise: bool) -> Picture:
    """sRGB code (IEC 61966-2-1) by the step of v."""
    top = 2.0 * np.sqrt(FULL_WELL_E + READ_NOISE_E**2) + 8.0
    v = np.arange(int(top * _STEPS_PER_SIGMA) + 2) / _STEPS_PER_SIGMA
    electrons = 0.25 * v * v - READ_NOISE_E**2 - (0.25 if noise else 0.0)
    linear = np.clip(gain * electrons / FULL_WELL_E, 0.0, 1.0)
    curve = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1.0 / 2.4) - 0.055)
    return np.round(255.0 * curve).astype(np.uint8)

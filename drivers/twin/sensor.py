"""The image sensor: blur, electrons, shot and read noise, sRGB codes."""

from __future__ import annotations

import math

import cv2
import numpy as np

from drivers.twin.canvas import Floats, Picture

FULL_WELL_E = 9000.0
READ_NOISE_E = 7.0
BLUR_PX = 0.55
ELECTRONS_PER_EXPOSURE = 9000.0 * 2.0  # per W/m2/sr and second
_TAIL_SIGMA = 4.0
_POOL_ROWS, _POOL_COLUMNS = 768, 2560


class Sensor:
    """Turns pictures of radiance into 8 bit sRGB.

    Shot and read noise: with v = 2 sqrt(e + r^2), v plus a unit normal number stands for e electrons with variance
    e + r^2 (Anscombe 1948), so a pool of unit normal numbers, drawn once, serves every level of light. v is kept in 256
    steps over what the picture can reach: fine steps at dusk, about 1.3 a standard deviation at noon.
    """

    def __init__(self, image_size: tuple[int, int], seed: int) -> None:
        width, height = image_size
        self._shape = (height, width)
        self._seed = seed
        needed = max(_POOL_ROWS, height + 64), max(_POOL_COLUMNS, 3 * width + 64)
        rng = np.random.default_rng([seed, 5])
        self._pool: Floats = rng.standard_normal(needed, dtype=np.float32)

    def expose(
        self, picture: Picture, full_scale: float, exposure_s: float, gain: float, frame: int, eye: int, *, noise: bool
    ) -> Picture:
        """(h, w, 3) BGR. ``picture`` holds codes 255 * sqrt(radiance / full_scale) in its first three channels."""
        electrons = ELECTRONS_PER_EXPOSURE * full_scale * exposure_s * (np.arange(256) / 255.0) ** 2
        electrons = np.minimum(electrons, FULL_WELL_E)
        steps = 255.0 / (2.0 * math.sqrt(electrons[-1] + READ_NOISE_E**2) + (_TAIL_SIGMA if noise else 0.0))
        # rounding to whole steps adds 1/12 step2 of variance: take it off the noise that is added
        grain = math.sqrt(max(steps**2 - 1.0 / 12.0, 0.0))
        table = (2.0 * steps) ** 2 * (electrons + READ_NOISE_E**2)
        level = cv2.LUT(cv2.cvtColor(picture, cv2.COLOR_BGRA2BGR), table.astype(np.float32))
        cv2.GaussianBlur(level, (3, 3), BLUR_PX, dst=level)
        flat = level.reshape(len(level), -1)
        cv2.sqrt(flat, flat)
        if noise:
            cv2.scaleAdd(self._noise(frame, eye), grain, flat, flat)
        return np.asarray(cv2.LUT(cv2.convertScaleAbs(level), _codes(gain, steps, noise)), dtype=np.uint8)

    def _noise(self, frame: int, eye: int) -> Floats:
        """(h, 3 w) unit normal numbers, from a place in the pool that (seed, frame, eye) draw."""
        rng = np.random.default_rng([self._seed, frame, eye])
        height, width = self._shape
        row = int(rng.integers(0, self._pool.shape[0] - height + 1))
        column = int(rng.integers(0, self._pool.shape[1] - 3 * width + 1))
        return self._pool[row : row + height, column : column + 3 * width]


def _codes(gain: float, steps: float, noise: bool) -> Picture:
    """(256,) sRGB code (IEC 61966-2-1) by v in steps."""
    v = np.arange(256) / steps
    electrons = 0.25 * v * v - READ_NOISE_E**2 - (0.25 if noise else 0.0)
    linear = np.clip(gain * electrons / FULL_WELL_E, 0.0, 1.0)
    curve = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1.0 / 2.4) - 0.055)
    return np.round(255.0 * curve).astype(np.uint8)

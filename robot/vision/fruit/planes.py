"""An image as planes at working resolution that do not depend on exposure or gain.

Linear light is averaged down first (the cheapest denoiser); chroma are ratios of it, so that a common gain cancels.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

Image = npt.NDArray[np.uint8]
Plane = npt.NDArray[np.float32]

WORKING_LONG_SIDE_PX = 320
DARK_SHARE, DARK_LEAST, DARK_MOST = 0.04, 0.0006, 0.004
"""Light added to every denominator: a share of the picture's mean light, within two to thirteen 8-bit codes."""


@dataclass(frozen=True, slots=True, eq=False)
class Planes:
    """One image at working resolution.

    ``light`` (h, w, 3) linear BGR, 0..1; ``red_green`` and ``yellow_blue`` (h, w) chroma ratios; ``log_light`` (h, w);
    ``dark`` the light added to denominators; ``scale_x``, ``scale_y`` pixels of the stored image per working pixel.
    """

    light: Plane
    red_green: Plane
    yellow_blue: Plane
    log_light: Plane
    dark: float
    scale_x: float
    scale_y: float

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) in working pixels."""
        return self.light.shape[1], self.light.shape[0]

    def to_stored(self, points: npt.ArrayLike) -> npt.NDArray[np.float64]:
        """(..., 2) working pixels to stored pixels; pixel centres at integers in both."""
        scale = np.array([self.scale_x, self.scale_y])
        return np.asarray((np.asarray(points, dtype=np.float64) + 0.5) * scale - 0.5)

    def from_stored(self, points: npt.ArrayLike) -> npt.NDArray[np.float64]:
        """(..., 2) stored pixels to working pixels."""
        scale = np.array([self.scale_x, self.scale_y])
        return np.asarray((np.asarray(points, dtype=np.float64) + 0.5) / scale - 0.5)


def check_image(image: Image) -> None:
    """Raise ``ValueError`` unless the image is (height, width, 3) of uint8 with at least 16 pixels a side."""
    if image.ndim != 3 or image.shape[2] != 3 or image.dtype != np.uint8:
        raise ValueError(
            f"expected a (height, width, 3) uint8 BGR image, found {image.shape} of {image.dtype}; convert it first"
        )
    if min(image.shape[:2]) < 16:
        raise ValueError(f"expected an image of at least 16 x 16 pixels, found {image.shape[1]} x {image.shape[0]}")


def planes_of(image: Image) -> Planes:
    """Planes of a (height, width, 3) BGR sRGB image."""
    light = working_light(linear_light(image))
    height, width = image.shape[:2]
    return planes_of_light(light, width / light.shape[1], height / light.shape[0])


def planes_of_light(light: Plane, scale_x: float, scale_y: float) -> Planes:
    """Planes of (h, w, 3) linear light at working resolution."""
    dark = dark_level(light)
    red_green, yellow_blue, log_light = chroma(light, dark)
    return Planes(light, red_green, yellow_blue, log_light, dark, scale_x, scale_y)


def dark_level(light: Plane) -> float:
    """What is added to the denominators of a picture's ratios, in linear light."""
    return float(np.clip(DARK_SHARE * light.mean(), DARK_LEAST, DARK_MOST))


def linear_light(image: Image) -> Plane:
    """(height, width, 3) linear BGR light, 0..1, of an sRGB image of the same shape."""
    check_image(image)
    return np.asarray(cv2.LUT(image, _linear_table()), dtype=np.float32)


def working_light(light: Plane) -> Plane:
    """(h, w, 3): linear light averaged down until its long side is at most WORKING_LONG_SIDE_PX."""
    height, width = light.shape[:2]
    reduction = max(1.0, max(height, width) / WORKING_LONG_SIDE_PX)
    size = (max(8, round(width / reduction)), max(8, round(height / reduction)))
    if size == (width, height):
        return light
    return np.asarray(cv2.resize(light, size, interpolation=cv2.INTER_AREA), dtype=np.float32)


def chroma(light: npt.ArrayLike, dark: float) -> tuple[Plane, Plane, Plane]:
    """(R-G)/S, (R+G-2B)/S and log S of linear BGR light, with S = R + G + B + 3 dark levels."""
    blue, green, red = (np.asarray(p, dtype=np.float32) for p in cv2.split(np.asarray(light, dtype=np.float32)))
    total = blue + green + red + np.float32(3 * dark)
    return (red - green) / total, (red + green - 2 * blue) / total, np.asarray(np.log(total), dtype=np.float32)


def _linear_table() -> npt.NDArray[np.float32]:
    """sRGB code to linear light (IEC 61966-2-1)."""
    code = np.arange(256) / 255.0
    linear = np.where(code <= 0.04045, code / 12.92, ((code + 0.055) / 1.055) ** 2.4)
    return linear.astype(np.float32)

"""Labelled pictures: a stereo scene with its fruit, a photograph with its boxes, and sets of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from robot.vision.stereo_rig import StereoRig

Image = npt.NDArray[np.uint8]
Array = npt.NDArray[np.float64]

_LUMINANCE_BGR = np.array([0.0722, 0.7152, 0.2126])


@dataclass(frozen=True, slots=True, eq=False)
class TrueFruit:
    """A fruit that is there.

    ``centre_m`` (3,) in the left camera frame; ``diameter_m`` of the sphere of equal volume; ``visible_fraction`` the
    smaller of both views'; ``left_px`` (u, v, r) of its projected centre and of a disc of its whole outline's area.
    """

    id: int
    centre_m: Array
    diameter_m: float
    ripeness: str
    visible_fraction: float
    left_px: tuple[float, float, float]
    touching: bool


@dataclass(frozen=True, slots=True)
class SceneFacts:
    """What a scene's results are sorted by. ``light_percent``: mean linear luminance, left image, of full scale."""

    name: str
    hour: int
    lamp: bool
    weather: str
    rig: str
    light_percent: float


@dataclass(frozen=True, slots=True, eq=False)
class StereoScene:
    """A stored (not rectified) BGR pair with its rig and every fruit in it."""

    facts: SceneFacts
    left: Image
    right: Image
    rig: StereoRig
    fruits: tuple[TrueFruit, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Photo:
    """A BGR photograph and its boxes (n, 4) of xmin, ymin, xmax, ymax in pixels."""

    name: str
    image: Image
    boxes: Array


@dataclass(frozen=True, slots=True)
class StereoSet:
    """Scenes by name; ``load`` gives the same scene for the same name."""

    key: str
    title: str
    names: tuple[str, ...]
    load: Callable[[str], StereoScene]

    def first(self, count: int | None) -> StereoSet:
        """``count`` scenes spread over the set, or all of it for None."""
        return StereoSet(self.key, self.title, spread(self.names, count), self.load)


@dataclass(frozen=True, slots=True)
class PhotoSet:
    """Photographs by name."""

    key: str
    title: str
    names: tuple[str, ...]
    load: Callable[[str], Photo]

    def first(self, count: int | None) -> PhotoSet:
        """``count`` photographs spread over the set, or all of it for None."""
        return PhotoSet(self.key, self.title, spread(self.names, count), self.load)


def spread(names: tuple[str, ...], count: int | None) -> tuple[str, ...]:
    """``count`` of the names at even steps, in their order."""
    if count is None or count >= len(names):
        return names
    return tuple(names[k * len(names) // count] for k in range(count))


def light_percent(image: Image) -> float:
    """Mean luminance of an sRGB BGR image after its curve is undone, in per cent of white."""
    codes = np.arange(256) / 255.0
    linear = np.where(codes <= 0.04045, codes / 12.92, ((codes + 0.055) / 1.055) ** 2.4)
    means = np.array([np.bincount(image[..., k].ravel(), minlength=256) @ linear for k in range(3)])
    return float(100.0 * _LUMINANCE_BGR @ means / (image.shape[0] * image.shape[1]))

"""A light meter that looks at plants and fruit, not at sky, wall and soil."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

Image = npt.NDArray[np.uint8]
Floats = npt.NDArray[np.float32]

_GRID_PX = 160          # views are averaged down to about that width: it takes the noise off their colours
_DARK = 3e-4, 0.02      # keeps the colour of what is black from being noise: of full scale, and of the view's mean
_PALE_QUANTILE = 0.05   # the least yellow of the view stands for what is pale in this light
_YELLOWER = 0.4, 1.4    # log2 above it: from here on it may be a plant, from there on it is
_BURNT = 0.96           # of full scale
_LEAST_SHARE = 0.02     # with fewer plants than that, the whole view is metered
_HIGHLIGHT_QUANTILE = 0.98
_BACKLIGHT_RATIO = 8.0
_VEIL_SHARE = 0.5       # of the median; the darkest percent has at most 0.44 of it in clear greenhouse pictures
_FLAT = 1.5             # brightest over darkest percent of a picture that shows nothing but a wall

_CODES = np.arange(256) / 255.0
_LINEAR = np.where(_CODES <= 0.04045, _CODES / 12.92, ((_CODES + 0.055) / 1.055) ** 2.4).astype(np.float32)


@dataclass(frozen=True, slots=True)
class Reading:
    """What a pair tells of the light on the plants; levels are linear, 0..1 of full scale, of the brightest channel.

    ``level``, ``highlight``: mean and 98th percentile of the plants. ``signal``: their level at a gain of 1, which the
    sensor's noise is measured by. ``plant_share``: of both views. ``burnt_share``, ``dark_share``: of the plants, at
    full scale, and below a tenth of their mean. ``illumination_1_s``: level over exposure (s) and gain, the same
    whatever the camera is set to. ``backlight``: what is behind the plants is much brighter than they are. ``glare``:
    stray light in the lens lifts even what is black. ``plants_seen`` False: there are none to be seen, and the figures
    are those of the whole picture.
    """

    level: float
    signal: float
    highlight: float
    plant_share: float
    burnt_share: float
    dark_share: float
    illumination_1_s: float
    backlight: bool
    glare: bool
    plants_seen: bool


def meter(left: Image, right: Image, exposure_s: float, gain: float) -> Reading:
    """Read the light from a pair of (height, width, 3) BGR views, 8 bit sRGB.

    Plants are told by their colour: leaf and fruit, red or green, reflect little blue. How yellow a pixel is
    (log2 of red and green over blue) is held against the palest of its view, so that neither gain nor the light's
    colour nor the white balance matters. ``ValueError`` for other shapes and types, and settings not above 0.
    """
    if not (exposure_s > 0.0 and gain > 0.0):
        raise ValueError(f"exposure: expected seconds and gain above 0, found {exposure_s:g} s and {gain:g}")
    views = [_linear(view, name) for name, view in (("left", left), ("right", right))]
    brightest = np.concatenate([view.max(axis=2).ravel() for view in views])
    white = np.concatenate([(view.min(axis=2) >= _BURNT).ravel() for view in views])
    plants = np.concatenate([_plantness(view).ravel() for view in views])
    plants[white] = 0.0
    share = float(plants.mean())
    seen = share >= _LEAST_SHARE
    weights = plants if seen else np.ones_like(plants)
    level = float(np.average(brightest, weights=weights))
    pale = 1.0 - plants
    behind = float(np.average(brightest, weights=pale)) if float(pale.sum()) > 0.0 else 0.0
    return Reading(
        level=level,
        signal=level / gain,
        highlight=_quantile(brightest, weights, _HIGHLIGHT_QUANTILE),
        plant_share=share,
        burnt_share=float(np.average(brightest >= _BURNT, weights=weights)),
        dark_share=float(np.average(brightest < 0.1 * level, weights=weights)),
        illumination_1_s=level / (exposure_s * gain),
        backlight=seen and float(pale.mean()) > 0.1 and behind > _BACKLIGHT_RATIO * level,
        glare=_veiled(brightest),
        plants_seen=seen,
    )


def _linear(view: Image, name: str) -> Floats:
    """The view in linear light, averaged down."""
    if view.ndim != 3 or view.shape[2] != 3 or view.dtype != np.uint8 or view.size == 0:
        raise ValueError(f"{name}: expected (height, width, 3) BGR of uint8, found {view.shape} of {view.dtype}")
    height, width = view.shape[:2]
    shrink = max(1, round(width / _GRID_PX))
    if shrink > 4:  # of a fine view every second pixel is enough
        view = view[::2, ::2]
    size = max(1, width // shrink), max(1, height // shrink)
    light = cv2.LUT(np.ascontiguousarray(view), _LINEAR)
    return np.asarray(cv2.resize(light, size, interpolation=cv2.INTER_AREA), dtype=np.float32)


def _plantness(view: Floats) -> Floats:
    """From 0 (as pale as the palest) to 1 for every pixel."""
    blue, green, red = view[..., 0], view[..., 1], view[..., 2]
    dark = _DARK[0] + _DARK[1] * float(view.mean())
    yellow = np.log2((0.5 * (red + green) + dark) / (blue + dark))
    start, sure = _YELLOWER
    above = (yellow - np.quantile(yellow, _PALE_QUANTILE) - start) / (sure - start)
    return np.asarray(np.clip(above, 0.0, 1.0), dtype=np.float32)


def _veiled(brightest: Floats) -> bool:
    low, middle, high = np.quantile(brightest, (0.01, 0.5, 0.99))
    return bool(low > _VEIL_SHARE * middle and high > _FLAT * low)


def _quantile(values: Floats, weights: Floats, share: float) -> float:
    order = np.argsort(values)
    sums = np.cumsum(weights[order], dtype=np.float64)
    return float(values[order][min(int(np.searchsorted(sums, share * sums[-1])), len(values) - 1)])

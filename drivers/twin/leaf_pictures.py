"""Pictures of tomato leaflets: shape, veins and mottle, drawn once from a fixed seed."""

from __future__ import annotations

import math
from functools import cache

import cv2
import numpy as np
import numpy.typing as npt

Picture = npt.NDArray[np.uint8]
Array = npt.NDArray[np.float64]

SIZE_PX = 128
PAIRS = (0, 1, 2, 3, 4)
TERMINALS = (5, 6, 7, 8)
PICTURES = 9
LEVELS = (128, 64, 32)
_DRAWN_PX = 512
_BLADE = np.array([0.030, 0.115, 0.040])  # linear reflectance, BGR
_VEIN = np.array([0.075, 0.215, 0.105])
_SEED = 20061


@cache
def leaf_picture(index: int, size_px: int = SIZE_PX) -> Picture:
    """(size, size, 4) BGRA: square root of linear reflectance times 255, and coverage; row 0 is the leaf's foot."""
    if size_px != SIZE_PX:
        whole = leaf_picture(index)
        small = cv2.resize(whole, (size_px, size_px), interpolation=cv2.INTER_AREA)
        return np.asarray(small, dtype=np.uint8)
    rng = np.random.default_rng([_SEED, index])
    mask = np.zeros((_DRAWN_PX, _DRAWN_PX), np.uint8)
    veins = np.zeros_like(mask)
    if index in PAIRS:
        _stroke(veins, mask, np.array([[0.5, 0.0], [0.5, 1.0]]), 0.022)
        for side in (-1.0, 1.0):
            foot = np.array([0.5, rng.uniform(0.06, 0.2)])
            _leaflet(mask, veins, foot, side * rng.uniform(1.15, 1.45), rng.uniform(0.44, 0.52), rng)
            if rng.random() < 0.8:
                foot = np.array([0.5, rng.uniform(0.52, 0.66)])
                _leaflet(mask, veins, foot, side * rng.uniform(0.75, 1.2), rng.uniform(0.3, 0.42), rng)
    else:
        _stroke(veins, mask, np.array([[0.5, 0.0], [0.5, 0.2]]), 0.03)
        _leaflet(mask, veins, np.array([0.5, 0.06]), rng.uniform(-0.12, 0.12), 0.9, rng)
    return _painted(mask, veins, rng)


@cache
def leaf_extents() -> Array:
    """(pictures, 4) least u, v and greatest u, v, 0 to 1, of what each picture covers."""
    out = np.empty((PICTURES, 4))
    for k in range(PICTURES):
        v, u = np.nonzero(leaf_picture(k)[:, :, 3])
        out[k] = [u.min(), v.min(), u.max() + 1, v.max() + 1]
    return out / SIZE_PX


@cache
def leaf_coverage(index: int) -> npt.NDArray[np.bool_]:
    """(size, size) where the leaf is: coverage of one half and more; indexed [v, u]."""
    return np.asarray(leaf_picture(index)[:, :, 3] > 127)


def _leaflet(
    mask: Picture, veins: Picture, foot: Array, bearing_rad: float, length: float, rng: np.random.Generator
) -> None:
    """A lobed, pointed blade from its foot; ``bearing_rad`` from the leaf's direction; lengths in picture widths."""
    along = np.array([math.sin(bearing_rad), math.cos(bearing_rad)])
    across = np.array([along[1], -along[0]])
    s = np.linspace(0.0, 1.0, 60)
    body = np.sin(np.pi * s**0.75) ** 0.8 * (1.0 - 0.45 * s)
    edges = []
    for side in (-1.0, 1.0):
        lobes = 1.0 + 0.28 * np.abs(np.sin(np.pi * (3.5 * s + rng.uniform(0.0, 0.3)))) - 0.14 + rng.normal(0, 0.015, 60)
        half = 0.42 * length * body * lobes
        edges.append(foot + np.outer(length * s, along) + np.outer(side * half, across))
    outline = np.vstack([edges[0], edges[1][::-1]])
    cv2.fillPoly(mask, [_fixed(outline)], 255, cv2.LINE_AA, 8)
    _stroke(veins, None, np.array([foot, foot + 0.95 * length * along]), 0.012)
    for start in np.linspace(0.12, 0.8, 7):
        reach = 0.33 * length * float(np.interp(start + 0.1, s, body))
        base = foot + start * length * along
        for side in (-1.0, 1.0):
            tip = base + reach * (0.75 * along + side * across)
            middle = base + 0.5 * reach * (0.3 * along + side * across)
            _stroke(veins, None, np.array([base, middle, tip]), 0.005)


def _stroke(veins: Picture, mask: Picture | None, points: Array, width: float) -> None:
    thickness = max(1, round(width * _DRAWN_PX))
    for canvas in (veins, mask):
        if canvas is not None:
            cv2.polylines(canvas, [_fixed(points)], False, 255, thickness, cv2.LINE_AA, 8)


def _fixed(points: Array) -> npt.NDArray[np.int32]:
    return np.round(points * _DRAWN_PX * 256.0).astype(np.int32)


def _painted(mask: Picture, veins: Picture, rng: np.random.Generator) -> Picture:
    coarse = cv2.resize(rng.normal(0.0, 1.0, (9, 9)), (_DRAWN_PX, _DRAWN_PX), interpolation=cv2.INTER_CUBIC)
    fine = cv2.resize(rng.normal(0.0, 1.0, (48, 48)), (_DRAWN_PX, _DRAWN_PX), interpolation=cv2.INTER_CUBIC)
    vein = cv2.GaussianBlur(veins, (0, 0), 1.5).astype(np.float64)[..., None] / 255.0
    # between the veins the blade bulges: it darkens towards them before they brighten
    fold = cv2.GaussianBlur(veins, (0, 0), 9.0).astype(np.float64)[..., None] / 255.0
    shade = np.clip(1.0 + 0.16 * coarse + 0.08 * fine, 0.4, 1.6)[..., None] * (1.12 - 0.8 * np.minimum(fold, 0.4))
    colour = _BLADE * shade * (1.0 - 0.75 * vein) + _VEIN * 0.75 * vein
    out = np.empty((_DRAWN_PX, _DRAWN_PX, 4), np.uint8)
    out[..., :3] = np.round(np.sqrt(np.clip(colour, 0.0, 1.0)) * 255.0)
    out[..., 3] = mask
    return np.asarray(cv2.resize(out, (SIZE_PX, SIZE_PX), interpolation=cv2.INTER_AREA), dtype=np.uint8)

"""Where circles may be: ring evidence in the skin map, chroma and light, in octaves of radius.

Ring evidence is linear in maps made from the gradient, so that all radii of an octave cost one Fourier transform a map:
a signed map sums the inward component of the gradient over the ring; an unsigned one sums cos 2(a - b) between the
gradient's direction a and the ring's normal b (light may rise or fall at a fruit's edge).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
import numpy.typing as npt
import scipy.fft

from robot.vision.fruit.planes import Plane, Planes

Array = npt.NDArray[np.float64]
OCTAVE_RADII_PX = (4.6, 5.5, 6.5, 7.7)
GRID = 64.0
"""Circles are rounded to this part of a pixel: the last bits of a Fourier transform depend on where memory lies."""
SKIN_WEIGHT, LIGHT_WEIGHT, CHROMA_WEIGHT, FILL_WEIGHT = 0.3, 1.0, 0.5, 0.1


@dataclass(frozen=True, slots=True, eq=False)
class Candidates:
    """Circles in working pixels: ``circles`` (n, 3) of u, v, r, best first; ``evidence`` (n,)."""

    circles: Array
    evidence: Array

    def __len__(self) -> int:
        return len(self.circles)


def find_candidates(planes: Planes, skin: Plane, limit: int, minimum_evidence: float = 0.1) -> Candidates:
    """At most ``limit`` circles, strongest first, none of which is nearly another."""
    found: list[Array] = []
    size = planes.size
    light = planes.log_light
    chroma = planes.red_green
    octave_skin = skin
    for octave in range(6):
        factor = 2**octave
        width, height = max(4, round(size[0] / factor)), max(4, round(size[1] / factor))
        if octave:
            octave_skin = _reduce(octave_skin, (width, height))
            light = _reduce(light, (width, height))
            chroma = _reduce(chroma, (width, height))
        if max(width, height) < 2 * OCTAVE_RADII_PX[0]:
            break
        volume = _evidence(octave_skin, chroma, light)
        peaks = _peaks(volume, 3 * limit, minimum_evidence)
        scale = np.array([size[0] / width, size[1] / height])
        peaks[:, :2] = (peaks[:, :2] + 0.5) * scale - 0.5
        peaks[:, 2] *= scale.mean()
        found.append(peaks)
    return _thin(np.concatenate(found), limit)


def _reduce(plane: Plane, size: tuple[int, int]) -> Plane:
    return np.asarray(cv2.resize(plane, size, interpolation=cv2.INTER_AREA), dtype=np.float32)


def _evidence(skin: Plane, chroma: Plane, light: Plane) -> Plane:
    """(radii, h, w) evidence; beyond the border the maps keep the border's value."""
    pad = int(np.ceil(OCTAVE_RADII_PX[-1])) + 2
    height, width = skin.shape
    skin, chroma, light = (_continued(plane, pad) for plane in (skin, chroma, light))
    light_x, light_y = _saturated(*_gradient(light), 0.15)
    chroma_x, chroma_y = _saturated(*_gradient(chroma), 0.05)
    double_cos = LIGHT_WEIGHT * (light_x**2 - light_y**2) + CHROMA_WEIGHT * (chroma_x**2 - chroma_y**2)
    double_sin = 2 * LIGHT_WEIGHT * light_x * light_y + 2 * CHROMA_WEIGHT * chroma_x * chroma_y
    rows = scipy.fft.next_fast_len(skin.shape[0] + pad, real=True)
    columns = scipy.fft.next_fast_len(skin.shape[1] + pad, real=True)
    spectra = scipy.fft.rfft2(np.stack([skin - np.float32(0.5), double_cos, double_sin]), (rows, columns), axes=(1, 2))
    out = np.empty((len(OCTAVE_RADII_PX), height, width), dtype=np.float32)
    for k, kernel in enumerate(_kernel_spectra(rows, columns)):
        product = spectra[0] * kernel[0]
        product += spectra[1] * kernel[1]
        product += spectra[2] * kernel[2]
        whole = scipy.fft.irfft2(product, (rows, columns))
        out[k] = whole[pad : pad + height, pad : pad + width]
    return out


@lru_cache(maxsize=16)
def _kernel_spectra(rows: int, columns: int) -> tuple[npt.NDArray[np.complex64], ...]:
    """For each radius the spectra (3, rows, columns // 2 + 1) to multiply those of skin and of the two maps with.

    Skin counts by its gradient towards the middle of the ring and by how it fills the disc: one kernel for both.
    """
    y = np.fft.fftfreq(rows, 1 / rows)[:, None]
    x = np.fft.fftfreq(columns, 1 / columns)[None, :]
    distance = np.hypot(x, y)
    angle = np.arctan2(y, x)
    scharr = np.zeros((2, rows, columns))
    for offset, weight in ((-1, 3 / 32), (0, 10 / 32), (1, 3 / 32)):
        scharr[0, offset, 1], scharr[0, offset, -1] = weight, -weight
        scharr[1, 1, offset], scharr[1, -1, offset] = weight, -weight
    slope = scipy.fft.rfft2(scharr, axes=(1, 2))
    out = []
    for radius in OCTAVE_RADII_PX:
        ring = np.exp(-0.5 * ((distance - radius) / 0.75) ** 2)
        disc = (distance < 0.85 * radius).astype(np.float64)
        ring /= ring.sum()
        disc /= disc.sum()
        gain = 3.0  # a full step of skin over about three pixels of gradient support counts one
        inward = scipy.fft.rfft2(-gain * ring * np.stack([np.cos(angle), np.sin(angle)]), axes=(1, 2))
        skin = SKIN_WEIGHT * (inward * slope).sum(axis=0) + 2 * FILL_WEIGHT * scipy.fft.rfft2(disc)
        double = scipy.fft.rfft2(ring * np.stack([np.cos(2 * angle), np.sin(2 * angle)]), axes=(1, 2))
        out.append(np.conj(np.concatenate([skin[None], double])).astype(np.complex64))
    return tuple(out)


def _continued(plane: Plane, pad: int) -> Plane:
    return np.asarray(cv2.copyMakeBorder(plane, pad, pad, pad, pad, cv2.BORDER_REPLICATE), dtype=np.float32)


def _gradient(plane: Plane) -> tuple[Plane, Plane]:
    return np.asarray(cv2.Scharr(plane, cv2.CV_32F, 1, 0) / 32), np.asarray(cv2.Scharr(plane, cv2.CV_32F, 0, 1) / 32)


def _saturated(x: Plane, y: Plane, knee: float) -> tuple[Plane, Plane]:
    """The same directions with lengths size / (size + knee), below 1."""
    size = np.sqrt(x * x + y * y) + np.float32(knee)  # cv2.magnitude differs from run to run in the last bits
    return x / size, y / size


def _peaks(volume: Plane, limit: int, minimum: float) -> Array:
    """Local maxima over 3 x 3 pixels and neighbouring radii, (n, 4) of u, v, r and evidence, refined by parabolas."""
    radii, height, width = volume.shape
    flat = volume.max(axis=0)
    top = (flat >= cv2.dilate(flat, np.ones((3, 3), np.uint8))) & (flat > minimum)
    v, u = np.nonzero(top)
    order = np.argsort(-flat[v, u])[:limit]
    v, u = v[order], u[order]
    k = volume[:, v, u].argmax(axis=0)
    step_u = _parabola(volume[k, v, np.maximum(u - 1, 0)], flat[v, u], volume[k, v, np.minimum(u + 1, width - 1)])
    step_v = _parabola(volume[k, np.maximum(v - 1, 0), u], flat[v, u], volume[k, np.minimum(v + 1, height - 1), u])
    step_k = _parabola(volume[np.maximum(k - 1, 0), v, u], flat[v, u], volume[np.minimum(k + 1, radii - 1), v, u])
    step_k[(k == 0) | (k == radii - 1)] = 0.0
    radius = np.interp(k + step_k, np.arange(radii), OCTAVE_RADII_PX)
    return np.column_stack([u + step_u, v + step_v, radius, flat[v, u]]).astype(np.float64)


def _parabola(before: Plane, here: Plane, after: Plane) -> Plane:
    bend = 2 * here - before - after
    step = np.where(bend > 1e-9, 0.5 * (after - before) / np.maximum(bend, 1e-9), 0.0)
    return np.asarray(np.clip(step, -0.5, 0.5), dtype=np.float32)


def _thin(found: Array, limit: int) -> Candidates:
    """Strongest first; drop a circle whose centre and radius are both near a stronger one's."""
    found = found[np.argsort(-found[:, 3])][: 8 * limit]
    kept: list[int] = []
    for k, (u, v, r, _) in enumerate(found):
        if len(kept) == limit:
            break
        others = found[kept]
        near = np.hypot(others[:, 0] - u, others[:, 1] - v) < 0.3 * np.minimum(others[:, 2], r)
        if not (near & (np.abs(np.log(others[:, 2] / r)) < 0.25)).any():
            kept.append(k)
    circles = np.round(found[kept, :3] * GRID) / GRID
    return Candidates(circles, np.round(found[kept, 3], 4))

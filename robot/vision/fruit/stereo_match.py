"""The disparity of each circle: the left disc warped as the front of a sphere and compared with the right image."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from robot.vision.fruit.contour import sample
from robot.vision.fruit.planes import Plane
from robot.vision.fruit.rectify import ParallelPair

Array = npt.NDArray[np.float64]
DISPARITIES = 56
DIFFERENCE_SCALES = (0.25, 0.35, 0.12, 0.2)
"""Differences of skin, log light and the two chroma that count as large."""


@dataclass(frozen=True, slots=True, eq=False)
class Match:
    """Of n circles: ``disparity_px`` (n,) of the centre, ``score`` (n,) 0..1, ``margin`` (n,) over the next best."""

    disparity_px: Array
    score: Array
    margin: Array


def disc_offsets() -> Array:
    """(k, 2) points of the disc and of a narrow rim outside, as shares of the radius."""
    rings = ((0.0, 1), (0.3, 6), (0.55, 10), (0.75, 14), (0.9, 18), (1.04, 18), (1.16, 18))
    return np.concatenate(
        [share * np.column_stack([np.cos(a), np.sin(a)]) for share, n in rings for a in [np.arange(n) * 2 * np.pi / n]]
    )


def match_discs(
    left: Plane,
    right: Plane,
    circles: Array,
    pair: ParallelPair,
    diameter_m: tuple[float, float],
    distance_m: tuple[float, float],
) -> Match:
    """The best disparity of each of (n, 3) left circles, in the range that the diameters and distances allow."""
    r = circles[:, 2]
    sine = r / np.hypot(r, pair.focal_px)
    far = np.minimum(distance_m[1], 0.5 * diameter_m[1] / sine)
    near = np.maximum(distance_m[0], 0.5 * diameter_m[0] / sine)
    far = np.maximum(far, 1.05 * near)
    reach = pair.focal_px * pair.baseline_m
    shares = np.linspace(0.0, 1.0, DISPARITIES)
    disparity = reach / far[:, None] + (reach / near - reach / far)[:, None] * shares
    difference, outside = disc_difference(left, right, circles, disparity, sine)
    scaled = difference @ (1.0 / np.asarray(DIFFERENCE_SCALES, dtype=np.float32))
    score = (1.0 / (1.0 + scaled)).mean(axis=2).astype(np.float64)
    score -= 0.5 * outside
    best = score.argmax(axis=1)
    rows = np.arange(len(circles))
    here = score[rows, best]
    before = score[rows, np.maximum(best - 1, 0)]
    after = score[rows, np.minimum(best + 1, DISPARITIES - 1)]
    bend = 2 * here - before - after
    inner = (best > 0) & (best < DISPARITIES - 1) & (bend > 1e-6)
    step = np.where(inner, np.clip(0.5 * (after - before) / np.maximum(bend, 1e-6), -0.5, 0.5), 0.0)
    found = disparity[rows, best] + step * (disparity[:, 1] - disparity[:, 0])
    apart = np.abs(disparity - found[:, None]) > 0.35 * r[:, None]
    rival = np.where(apart, score, -1.0).max(axis=1)
    return Match(found, here, here - np.maximum(rival, 0.0))


def disc_difference(left: Plane, right: Plane, circles: Array, disparity_px: Array, sine: Array) -> tuple[Plane, Array]:
    """(n, d, points, channels) absolute differences between the left disc, warped as a sphere's front, and the right.

    ``disparity_px`` (n, d) of the centre; ``sine`` (n,) of the half-angle of the outline. Also the share (n, d) of
    the points that lie outside the right image.
    """
    offsets = disc_offsets()
    height = np.sqrt(np.clip(1 - (offsets**2).sum(axis=1), 0.0, 1.0))
    left_u = circles[:, :1] + circles[:, 2:] * offsets[:, 0]
    left_v = circles[:, 1:2] + circles[:, 2:] * offsets[:, 1]
    nearer = 1.0 / (1.0 - sine[:, None] * height)
    right_u = left_u[:, None, :] - disparity_px[:, :, None] * nearer[:, None, :]
    difference = sample(right, right_u, np.broadcast_to(left_v[:, None, :], right_u.shape))
    difference -= sample(left, left_u, left_v)[:, None]
    return np.abs(difference, out=difference), (right_u < -2).mean(axis=2)

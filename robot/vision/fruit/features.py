"""Numbers that tell a fruit from what only looks like one: of a circle in one view, and of a fitted pair."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from robot.vision.fruit.contour import Contours, unwrap
from robot.vision.fruit.joint_fit import Spheroids
from robot.vision.fruit.planes import Plane

Array = npt.NDArray[np.float64]
INSIDE = np.array([0.1, 0.25, 0.4, 0.55, 0.7, 0.85])
OUTSIDE = np.array([1.15, 1.3, 1.45])
EDGE_SEEN = 0.22
"""Edge strength from which a piece of the outline counts as seen."""


@dataclass(frozen=True, slots=True, eq=False)
class ViewFeatures:
    """``values`` (n, m) for the verifier; ``tint`` (n, 4) for the ripeness; ``seen`` (n,) share of the outline seen."""

    values: Array
    tint: Array
    seen: Array


def view_features(stack: Plane, circles: Array, contours: Contours, residual_px: Array) -> ViewFeatures:
    """Of n circles (n, 3) in working pixels with their outlines and those outlines' residuals (n, k)."""
    count = len(circles)
    inside = unwrap(stack, circles, INSIDE).astype(np.float64)
    outside = unwrap(stack, circles, OUTSIDE).astype(np.float64)
    area = INSIDE / INSIDE.sum()
    mean_in = (inside.mean(axis=1) * area[None, :, None]).sum(axis=1)
    deviation = inside - mean_in[:, None, None, :]
    std_in = np.sqrt(((deviation**2).mean(axis=1) * area[None, :, None]).sum(axis=1))
    near = outside[:, :, 0]
    rim = inside[:, :, -1]
    contrast = np.abs(near - rim)
    mean_out = outside.mean(axis=(1, 2))
    strength = contours.strength
    relative = np.abs(residual_px) / circles[:, 2, None]
    good = np.clip(strength / EDGE_SEEN, 0, 1) * (relative < 0.12)
    seen = good.mean(axis=1)
    quarters = good.reshape(count, 4, good.shape[1] // 4).mean(axis=2)
    jump = np.abs(np.diff(contours.points, axis=1)).sum(axis=2).mean(axis=1) / circles[:, 2]
    rough = np.abs(np.diff(inside[..., 1], axis=1)).mean(axis=(1, 2))
    low, high = np.percentile(inside[..., 0].reshape(count, inside.shape[1] * inside.shape[2]), (15, 85), axis=1)
    height, width = stack.shape[:2]
    beyond = np.maximum.reduce(
        [
            circles[:, 2] - circles[:, 0],
            circles[:, 2] - circles[:, 1],
            circles[:, 0] + circles[:, 2] - width,
            circles[:, 1] + circles[:, 2] - height,
        ]
    )
    values = np.column_stack(
        [
            strength.mean(axis=1),
            np.percentile(strength, 25, axis=1),
            seen,
            quarters.min(axis=1),
            relative.mean(axis=1),
            np.percentile(relative, 80, axis=1),
            jump,
            mean_in,
            std_in,
            contrast.mean(axis=1),
            np.percentile(contrast[..., 0], 30, axis=1),
            mean_in[:, 0] - mean_out[:, 0],
            mean_in[:, 2:] - mean_out[:, 2:],
            low,
            high,
            rough,
            np.log(circles[:, 2]),
            np.clip(beyond / circles[:, 2], -1, 2),
            *_shading(inside[..., 1]),
        ]
    )
    sure = inside[..., 0] * area[None, None, :] + 1e-6
    tint = np.column_stack(
        [
            *(((inside[..., k] * sure).sum(axis=(1, 2)) / sure.sum(axis=(1, 2))) for k in (2, 3)),
            mean_in[:, 2] - mean_out[:, 2],
            mean_in[:, 3] - mean_out[:, 3],
        ]
    )
    return ViewFeatures(values, tint, seen)


def _shading(log_light: Array) -> tuple[Array, Array]:
    """Share of the light inside that a plane plus a bowl explains, and the bowl's depth (a lit sphere has both)."""
    count, angles, rings = log_light.shape
    turn = np.arange(angles) * 2 * np.pi / angles
    x = (np.cos(turn)[:, None] * INSIDE).ravel()
    y = (np.sin(turn)[:, None] * INSIDE).ravel()
    design = np.column_stack([np.ones_like(x), x, y, x * x + y * y])
    values = log_light.reshape(count, angles * rings)
    solution = values @ np.linalg.pinv(design).T
    left = values - solution @ design.T
    total = values.var(axis=1) + 1e-4
    return 1 - left.var(axis=1) / total, solution[:, 3]


def pair_features(
    left: ViewFeatures,
    right: ViewFeatures,
    fit: Spheroids,
    match_score: Array,
    match_margin: Array,
    evidence: Array,
    focal_px: float,
) -> Array:
    """(n, PAIR) inputs of the pair verifier."""
    diameter = 2 * fit.volume_radius_m
    distance = fit.centre_m[:, 2]
    fraction = (fit.weights > 0.3 * np.maximum(fit.weights.max(axis=(1, 2), keepdims=True), 1e-9)).mean(axis=2)
    error = np.abs(fit.residual_px).mean(axis=2)
    sigma = np.sqrt(np.maximum(np.diagonal(fit.covariance, axis1=1, axis2=2), 1e-12))
    radius_px = fit.radius_m / distance * focal_px
    return np.column_stack(
        [
            np.minimum(left.values, 30),
            0.5 * (left.values + right.values)[:, :20],
            np.abs(left.tint - right.tint),
            np.minimum(left.seen, right.seen),
            match_score,
            match_margin,
            evidence,
            diameter * 10,
            np.abs(diameter - 0.09) * 10,
            distance,
            fraction.min(axis=1),
            fraction.mean(axis=1),
            error.max(axis=1) / np.maximum(radius_px, 1.0),
            np.log(fit.sigma_px),
            np.log(sigma[:, 2] / distance),
            np.log(sigma[:, 3] / fit.radius_m),
            fit.harmonic,
            np.abs(fit.harmonic),
        ]
    )

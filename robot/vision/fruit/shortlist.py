"""The second look: the best hypotheses measured at full resolution, with features that judge the measurement."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from robot.vision.fruit.contour import unwrap
from robot.vision.fruit.hypotheses import Hypotheses
from robot.vision.fruit.joint_fit import Spheroids
from robot.vision.fruit.network import Network
from robot.vision.fruit.planes import Plane
from robot.vision.fruit.rectify import ParallelPair
from robot.vision.fruit.refine import refine
from robot.vision.fruit.stereo_match import disc_difference
from robot.vision.stereo_rig import StereoRig

Array = npt.NDArray[np.float64]
ALIKE = 0.3
"""Hypotheses nearer than this share of the radius, and than half of it in size, are one."""
SHARES = np.array([0.3, 0.6, 0.85, 1.15, 1.3])


@dataclass(frozen=True, slots=True, eq=False)
class Shortlist:
    """m of the hypotheses: ``fit`` refined, ``features`` (m, k) for the verdict, ``tint`` (m, 4) and ``seen`` (m,)."""

    fit: Spheroids
    features: Array
    tint: Array
    seen: Array


def shortlist(
    found: Hypotheses, full: tuple[Plane, Plane], rig: StereoRig, first: Network, limit: int, least: float = -4.5
) -> Shortlist:
    """At most ``limit`` hypotheses that the ``first`` verifier gives a logit of at least ``least``."""
    logits = first.logits(found.features).astype(np.float64)
    rows = _unlike(found.fit, logits[:, 0], limit)
    rows = rows[logits[rows, 0] >= least]
    coarse = found.fit[rows]
    fit = refine(coarse, full, rig, found.pair)
    focal = 0.5 * float(rig.K_left[0, 0] + rig.K_right[0, 0])
    features = np.column_stack(
        [
            found.features[rows],
            logits[rows],
            _edge_features(fit, coarse, focal),
            _inside_features(fit, found.pair, found.stacks),
        ]
    )
    tint = 0.5 * (found.left.tint + found.right.tint)[rows]
    return Shortlist(fit, np.nan_to_num(features), tint, _outline_seen(fit))


def _unlike(fit: Spheroids, logit: Array, limit: int) -> npt.NDArray[np.int64]:
    """The best ``limit`` rows of which none would be refined to the same fruit as a better one."""
    kept: list[int] = []
    for row in np.argsort(-logit, kind="stable"):
        apart = np.linalg.norm(fit.centre_m[kept] - fit.centre_m[row], axis=1) / fit.radius_m[row]
        size = np.abs(np.log(fit.radius_m[kept] / fit.radius_m[row]))
        if not ((apart < ALIKE) & (size < 0.5 * ALIKE)).any():
            kept.append(int(row))
        if len(kept) == limit:
            break
    return np.array(kept, dtype=np.int64)


def _outline_seen(fit: Spheroids) -> Array:
    """(m,) share of the outline with an edge on the fitted curve, in the view that shows less."""
    return np.asarray(np.clip(fit.weights / 0.25, 0.0, 1.0).mean(axis=2).min(axis=1))


def _edge_features(fit: Spheroids, coarse: Spheroids, focal_px: float) -> Array:
    count = len(fit.radius_m)
    weights = fit.weights
    seen = np.clip(weights / 0.25, 0.0, 1.0)
    quarters = seen.reshape(count, 2, 4, seen.shape[2] // 4).mean(axis=3)
    distance = fit.centre_m[:, 2]
    radius_px = fit.radius_m / distance * focal_px
    error = np.abs(fit.residual_px).mean(axis=2) / radius_px[:, None]
    bias = (fit.residual_px * weights).sum(axis=2) / (weights.sum(axis=2) + 1e-9) / radius_px[:, None]
    sigma = np.sqrt(np.maximum(np.diagonal(fit.covariance, axis1=1, axis2=2), 1e-12))
    diameter = 2 * fit.volume_radius_m
    moved = fit.centre_m - coarse.centre_m
    return np.column_stack(
        [
            weights.mean(axis=2).min(axis=1),
            weights.mean(axis=2).mean(axis=1),
            seen.mean(axis=2).min(axis=1),
            seen.mean(axis=2).mean(axis=1),
            quarters.min(axis=2).min(axis=1),
            quarters.min(axis=2).mean(axis=1),
            error.max(axis=1),
            error.mean(axis=1),
            np.abs(bias).max(axis=1),
            np.log(fit.sigma_px),
            np.log(sigma[:, 2] / distance),
            np.log(sigma[:, 3] / fit.radius_m),
            np.linalg.norm(moved, axis=1) / coarse.radius_m,
            np.linalg.norm(moved[:, :2], axis=1) / coarse.radius_m,
            moved[:, 2] / coarse.radius_m,
            np.log(fit.radius_m / coarse.radius_m),
            diameter * 10,
            np.abs(diameter - 0.09) * 10,
            distance,
            fit.harmonic,
            np.abs(fit.harmonic - [0.05, 0.0]),
        ]
    )


def working_circles(fit: Spheroids, pair: ParallelPair) -> tuple[Array, Array, Array, Array]:
    """Circles (m, 3) in the left and right view, disparity (m,) of the centres and sine (m,) of the half-angle."""
    x, y, z = fit.centre_m.T
    distance = np.linalg.norm(fit.centre_m, axis=1)
    sine = np.clip(fit.radius_m / distance, 1e-3, 0.9)
    radius = pair.focal_px * sine / np.sqrt(1 - sine**2)
    disparity = pair.focal_px * pair.baseline_m / z
    left = np.column_stack([pair.cu + pair.focal_px * x / z, pair.cv + pair.focal_px * y / z, radius])
    return left, left - np.column_stack([disparity, np.zeros((len(z), 2))]), disparity, sine


def _inside_features(fit: Spheroids, pair: ParallelPair, stacks: tuple[Plane, Plane]) -> Array:
    left, right, disparity, sine = working_circles(fit, pair)
    difference, outside = disc_difference(stacks[0], stacks[1], left, disparity[:, None], sine)
    columns = [difference[:, 0].mean(axis=1), outside]
    for stack, circles in zip(stacks, (left, right), strict=True):
        rings = unwrap(stack, circles, SHARES).mean(axis=1)
        columns += [rings[..., 0], rings[:, 2, 1:] - rings[:, 3, 1:]]
    return np.column_stack(columns).astype(np.float64)

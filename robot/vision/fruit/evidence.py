"""What speaks for and against a guess, in numbers, after both looks at it."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from robot.vision.fruit.measure import Traced
from robot.vision.fruit.pairing import Pairs
from robot.vision.fruit.polar import ANGLES
from robot.vision.fruit.proposals import Proposals
from robot.vision.fruit.rectify import ParallelPair

Array = npt.NDArray[np.float64]

QUARTERS = 4


def evidence_of(
    left: Proposals, right: Proposals, guesses: Pairs, first: Traced, second: Traced, pair: ParallelPair
) -> Array:
    """(n, k) numbers of the order of one for n guesses; ``left`` and ``right`` are their proposals."""
    coarse, fit = first.fit, second.fit
    count = len(fit.radius_m)
    radius_px = fit.radius_m / fit.centre_m[:, 2] * pair.focal_px
    moved = np.linalg.norm(fit.centre_m - coarse.centre_m, axis=1) / fit.radius_m
    moved_first = np.linalg.norm(coarse.centre_m - guesses.centre_m, axis=1) / coarse.radius_m
    weights = (fit.weights * second.shows).reshape(count, 2, QUARTERS, ANGLES // QUARTERS).mean(axis=3)
    sigma = np.sqrt(np.maximum(np.diagonal(fit.covariance, axis1=1, axis2=2), 1e-14))
    spread = np.log(second.sigma_px / radius_px[:, None, None])
    chances = np.stack([_logit(left.chance), _logit(right.chance)])
    return np.column_stack(
        [
            chances.min(axis=0),
            chances.max(axis=0),
            guesses.miss,
            first.verdict,
            second.verdict,
            spread.mean(axis=2).max(axis=1),
            spread.mean(axis=(1, 2)),
            first.shows.mean(axis=2).min(axis=1),
            first.shows.mean(axis=(1, 2)),
            second.shows.mean(axis=2).min(axis=1),
            weights.min(axis=(1, 2)),
            weights.mean(axis=(1, 2)),
            np.log(coarse.scale),
            np.log(fit.scale),
            np.log(np.abs(fit.residual_px).mean(axis=(1, 2)) / radius_px + 1e-4),
            np.log(coarse.radius_m / guesses.radius_m),
            np.log(fit.radius_m / coarse.radius_m),
            np.log(moved_first + 1e-3),
            np.log(moved + 1e-3),
            np.log(sigma[:, 2] / fit.centre_m[:, 2]),
            np.log(sigma[:, 3] / fit.radius_m),
            np.log(fit.radius_m / 0.04),
            np.log(fit.centre_m[:, 2] / 0.6),
            0.5 * (left.visible + right.visible),
            0.5 * (left.ripeness + right.ripeness),
        ]
    )


def _logit(chance: Array) -> Array:
    inside = np.clip(chance, 1e-4, 1 - 1e-4)
    return np.asarray(np.log(inside / (1 - inside)))

"""Proposals of both views that may be the same fruit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from robot.vision.fruit.parameters import FruitParameters
from robot.vision.fruit.proposals import Proposals
from robot.vision.fruit.rectify import ParallelPair
from robot.vision.stereo_rig import StereoRig

Array = npt.NDArray[np.float64]

ROW_SIGMA, SIZE_SIGMA, RIPENESS_SIGMA = 0.10, 0.10, 0.35
"""By how much proposals of one fruit differ: in the row, in shares of the radius; in log size; in ripeness."""
WORST = 4.0
"""Standard deviations at which two proposals are not of one fruit."""


@dataclass(frozen=True, slots=True, eq=False)
class Pairs:
    """n guesses of a fruit, likeliest first.

    ``left`` and ``right`` (n,) are rows of the proposals; ``centre_m`` (n, 3) in the pair's frame and ``radius_m``
    (n,) of a sphere; ``harmonic`` (n, 2) of its outline; ``score`` (n,) 0..1; ``miss`` (n,) how badly the views agree.
    """

    left: npt.NDArray[np.int64]
    right: npt.NDArray[np.int64]
    centre_m: Array
    radius_m: Array
    harmonic: Array
    score: Array
    miss: Array

    def __len__(self) -> int:
        return len(self.score)

    def __getitem__(self, rows: npt.NDArray[np.int64]) -> Pairs:
        """Some of them."""
        return Pairs(
            self.left[rows], self.right[rows], self.centre_m[rows], self.radius_m[rows], self.harmonic[rows],
            self.score[rows], self.miss[rows],
        )  # fmt: skip


def pairs_of(
    left: Proposals, right: Proposals, rig: StereoRig, pair: ParallelPair, parameters: FruitParameters
) -> Pairs:
    """Every plausible pair.

    The outline of a sphere is a cone about its centre: the middle of the box gives the ray, its size the angle.
    """
    (x_l, y_l, r_l), (x_r, y_r, r_r) = (_cones(found, rig, pair, eye) for eye, found in enumerate((left, right)))
    radius = np.sqrt(r_l[:, None] * r_r[None])
    disparity = x_l[:, None] - x_r[None]
    row = (y_l[:, None] - y_r[None]) / radius / ROW_SIGMA
    size = np.log(r_l[:, None] / r_r[None]) / SIZE_SIGMA
    tint = (left.ripeness[:, None] - right.ripeness[None]) / RIPENESS_SIGMA
    miss = np.sqrt(row**2 + size**2 + tint**2)
    near, far = parameters.distance_range_m
    smallest, largest = parameters.diameter_range_m
    range_m = pair.baseline_m / np.maximum(disparity, 1e-6)
    diameter = 2 * range_m * radius
    plausible = (miss < WORST) & (range_m > near) & (range_m < far)
    plausible &= (diameter > 0.8 * smallest) & (diameter < 1.25 * largest)
    i, j = np.nonzero(plausible)
    z, r = range_m[i, j], radius[i, j]
    x, y = x_l[i], 0.5 * (y_l[i] + y_r[j])
    sine = r / np.sqrt(1 + r**2)
    toward = np.stack([x * z, y * z, z], axis=1) / (1 - (sine**2)[:, None])
    score = np.sqrt(left.chance[i] * right.chance[j]) * np.exp(-0.5 * (miss[i, j] / 2.0) ** 2)
    wider = np.log(left.boxes[i, 2] / left.boxes[i, 3]) + np.log(right.boxes[j, 2] / right.boxes[j, 3])
    lean = np.clip(0.25 * wider, -0.15, 0.15)
    order = np.argsort(-score, kind="stable")[: parameters.candidates]
    size_m = np.linalg.norm(toward, axis=1) * sine
    return Pairs(i, j, toward, size_m, np.column_stack([lean, np.zeros(len(i))]), score, miss[i, j])[order]


def _cones(found: Proposals, rig: StereoRig, pair: ParallelPair, eye: int) -> tuple[Array, Array, Array]:
    """Direction x/z and y/z (n,) in the pair's frame, and tangent (n,) of the half-angle."""
    K, undistort = (rig.K_left, rig.undistort_left) if eye == 0 else (rig.K_right, rig.undistort_right)
    straight = undistort(found.boxes[:, :2])
    rays = np.column_stack([(straight - K[:2, 2]) / [K[0, 0], K[1, 1]], np.ones(len(found))])
    turned = rays @ (pair.rect_from_left if eye == 0 else pair.rect_from_right).T
    x, y = turned[:, 0] / turned[:, 2], turned[:, 1] / turned[:, 2]
    radius = 0.5 * np.sqrt(found.boxes[:, 2] * found.boxes[:, 3]) / np.sqrt(K[0, 0] * K[1, 1])
    slant = np.sqrt(1 + x**2 + y**2)
    return x, y, radius / slant**1.5

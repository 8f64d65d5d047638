"""Fruit seen from two stops as landmarks: the pose's error without satellites."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from robot.geometry import Pose2
from robot.navigation.pose import PoseFilter, update_relative

Vector = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class LandmarkRules:
    """``least`` landmarks make a correction; ``outlier_sigmas`` robust deviations from the median drop one.

    ``expected_m`` is the one-sigma scatter of one offset at least reckoned with, on each axis: few landmarks may agree
    by chance. ``floor_m`` is the least error of a correction, ``caution`` multiplies the error that the scatter shows.
    """

    least: int = 3
    outlier_sigmas: float = 3.0
    expected_m: float = 0.006
    floor_m: float = 0.002
    caution: float = 1.3


@dataclass(frozen=True, slots=True)
class PoseShift:
    """What to add to the pose (row frame), its one-sigma errors, and how many landmarks say so."""

    dx_m: float
    dy_m: float
    sigma_x_m: float
    sigma_y_m: float
    landmarks: int


def estimate_shift(offsets_m: Sequence[npt.ArrayLike], rules: LandmarkRules | None = None) -> PoseShift | None:
    """The shift of the pose from ``offsets_m``, one (2 or 3,) a landmark: seen less known position, row frame.

    Mean of the offsets that lie near their median (by median absolute deviation); None with too few landmarks.
    """
    rules = rules or LandmarkRules()
    if len(offsets_m) < rules.least:
        return None
    offsets = np.array([np.asarray(item, dtype=np.float64)[:2] for item in offsets_m])
    offsets = offsets[np.all(np.isfinite(offsets), axis=1)]
    if len(offsets) < rules.least:
        return None
    deviation = np.abs(offsets - np.median(offsets, axis=0))
    scatter = np.maximum(1.4826 * np.median(deviation, axis=0), rules.expected_m)
    kept = offsets[np.all(deviation <= rules.outlier_sigmas * scatter, axis=1)]
    if len(kept) < rules.least:
        return None
    middle = np.mean(kept, axis=0)
    spread = np.maximum(np.std(kept, axis=0, ddof=1), rules.expected_m)
    sigma = np.maximum(rules.floor_m, rules.caution * spread / math.sqrt(len(kept)))
    return PoseShift(-float(middle[0]), -float(middle[1]), float(sigma[0]), float(sigma[1]), len(kept))


def update_landmarks(before: PoseFilter, seen_from: Pose2, shift: PoseShift, stamp_s: float) -> PoseFilter:
    """Take in the shift that a frame's landmarks showed; the frame at ``stamp_s`` was placed with ``seen_from``."""
    xy_m = (seen_from.x_m + shift.dx_m, seen_from.y_m + shift.dy_m)
    return update_relative(before, xy_m, np.diag([shift.sigma_x_m**2, shift.sigma_y_m**2]), stamp_s)

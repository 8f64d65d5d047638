"""Satellite fixes that are good enough to move the pose."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from drivers.gps.values import Fix, FixQuality
from robot.navigation.enu import Datum, row_xy_m
from robot.navigation.pose import PoseFilter, pose_at, update_position


@dataclass(frozen=True, slots=True)
class FixRules:
    """Which fixes count. Errors of following epochs are alike (multipath, ionosphere): each counts as if it came with
    ``correlated_epochs`` equal ones, by quality. ``floor_m`` bounds what a receiver may claim.
    ``antenna_xy_m`` is the antenna in the base frame.
    """

    worst_quality: FixQuality = FixQuality.RTK_FLOAT
    worst_accuracy_m: float = 0.3
    floor_m: float = 0.008
    correlated_epochs: tuple[tuple[FixQuality, float], ...] = (
        (FixQuality.RTK_FIXED, 3.0),
        (FixQuality.RTK_FLOAT, 50.0),
        (FixQuality.DGPS, 200.0),
        (FixQuality.SINGLE, 200.0),
    )
    antenna_xy_m: tuple[float, float] = (0.0, 0.0)


def usable(fix: Fix, rules: FixRules) -> bool:
    """Whether a fix has a position of the quality and accuracy that the rules ask for."""
    return _measured(fix, rules) is not None


def update_fix(before: PoseFilter, fix: Fix, datum: Datum, rules: FixRules) -> PoseFilter:
    """Take in a fix, or leave the filter as it is when the rules refuse the fix or its stamp is off the trail."""
    measured = _measured(fix, rules)
    if measured is None:
        return before
    try:
        there = pose_at(before, fix.stamp_s)
    except ValueError:
        return before
    latitude_deg, longitude_deg, sigma_m = measured
    x_m, y_m = row_xy_m(latitude_deg, longitude_deg, datum)
    lever = there.transform().rotate((*rules.antenna_xy_m, 0.0))
    base_xy_m = (x_m - float(lever[0]), y_m - float(lever[1]))
    return update_position(before, base_xy_m, np.eye(2) * sigma_m**2, fix.stamp_s)


def _measured(fix: Fix, rules: FixRules) -> tuple[float, float, float] | None:
    """Latitude, longitude and the one-sigma error to reckon with."""
    if fix.latitude_deg is None or fix.longitude_deg is None or fix.accuracy_m is None:
        return None
    if fix.quality < max(rules.worst_quality, FixQuality.SINGLE):
        return None
    if not 0.0 <= fix.accuracy_m <= rules.worst_accuracy_m:
        return None
    epochs = dict(rules.correlated_epochs)[fix.quality]
    return fix.latitude_deg, fix.longitude_deg, max(fix.accuracy_m, rules.floor_m) * math.sqrt(epochs)

"""One more look at a fruit: what the book then believes about it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from robot.targets.matching import BookParameters
from robot.targets.ripeness import classify
from robot.targets.sighting import Sighting
from robot.targets.values import Target, TargetState

_LEAST_WEIGHT = 1e-3  # a look without any evidence still has a score


def first_look(target_id: int, seen: Sighting, stamp_s: float, parameters: BookParameters) -> Target:
    """A new target, open."""
    return Target(
        id=target_id,
        centre_m=seen.centre_m,
        covariance_m2=seen.covariance_m2,
        diameter_m=seen.diameter_m,
        diameter_sigma_m=seen.diameter_sigma_m,
        ripeness=classify(seen.ripeness_score, seen.ripeness, parameters.ripeness),
        ripeness_score=seen.ripeness_score,
        ripeness_weight=_weight(seen),
        confidence=seen.confidence,
        visible_fraction=seen.visible_fraction,
        measured=seen.measured,
        sightings=1,
        last_seen_s=stamp_s,
        state=TargetState.OPEN,
        reason="",
    )


def another_look(old: Target, seen: Sighting, stamp_s: float, parameters: BookParameters) -> Target:
    """Place by the inverse-covariance mean, size by the looks that measured it, ripeness by the mean of all looks."""
    centre_m, covariance_m2 = _place(old, seen, parameters)
    diameter_m, diameter_sigma_m = _size(old, seen, parameters)
    weight = _weight(seen)
    total = old.ripeness_weight + weight
    score = old.ripeness_score + weight / total * (seen.ripeness_score - old.ripeness_score)
    return replace(
        old,
        centre_m=centre_m,
        covariance_m2=covariance_m2,
        diameter_m=diameter_m,
        diameter_sigma_m=diameter_sigma_m,
        ripeness=classify(score, old.ripeness, parameters.ripeness),
        ripeness_score=score,
        ripeness_weight=total,
        confidence=max(old.confidence, seen.confidence),
        visible_fraction=max(old.visible_fraction, seen.visible_fraction),
        measured=old.measured or seen.measured,
        sightings=old.sightings + 1,
        last_seen_s=stamp_s,
    )


def _weight(seen: Sighting) -> float:
    """A sure look at much of the fruit says more about its colour."""
    return max(seen.confidence * seen.visible_fraction, _LEAST_WEIGHT)


def _place(
    old: Target, seen: Sighting, parameters: BookParameters
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """The old centre has aged by one change of pose, so the newest sighting never fades."""
    aged = old.covariance_m2 + np.eye(3) * parameters.pose_sigma_m**2
    gain = np.linalg.solve(aged + seen.covariance_m2 + np.eye(3) * 1e-10, aged).T
    centre_m = old.centre_m + gain @ (seen.centre_m - old.centre_m)
    covariance_m2 = aged - gain @ aged
    return centre_m, 0.5 * (covariance_m2 + covariance_m2.T)


def _size(old: Target, seen: Sighting, parameters: BookParameters) -> tuple[float, float]:
    """Diameter and sigma. A measured look overrules estimates, and no estimate moves a measured size.

    Looks of one kind: inverse-variance mean. Two estimates may guess alike about what one leaf hides, so together they
    are no surer than the better of them.
    """
    if old.measured and not seen.measured:
        return old.diameter_m, old.diameter_sigma_m
    if seen.measured and not old.measured:
        return seen.diameter_m, seen.diameter_sigma_m
    old_variance = old.diameter_sigma_m**2 + parameters.diameter_floor_m**2
    new_variance = seen.diameter_sigma_m**2 + parameters.diameter_floor_m**2
    weight = old_variance / (old_variance + new_variance)
    diameter_m = old.diameter_m + weight * (seen.diameter_m - old.diameter_m)
    if not seen.measured:
        return diameter_m, min(old.diameter_sigma_m, seen.diameter_sigma_m)
    return diameter_m, float(np.sqrt(weight * new_variance))

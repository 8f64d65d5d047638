"""Which targets the grower wants treated."""

from __future__ import annotations

import math
from dataclasses import dataclass

from robot.targets.values import Target, TargetState
from robot.vision.values import Ripeness

TOO_HIDDEN = "too hidden to measure"


@dataclass(frozen=True, slots=True)
class Policy:
    """Ripeness classes to treat, and the evidence and size that a target must have.

    A target that was seen once needs ``sure_confidence``: a fruit matched to the wrong place in the other eye looks
    right in one frame, and a second stop shows that it is not there. ``treat_hidden``: whether a fruit that is too
    hidden to measure is treated at all; its size is then out of range only if a sigma does not bring it back.
    """

    ripeness: frozenset[Ripeness] = frozenset(Ripeness)
    min_confidence: float = 0.5
    sure_confidence: float = 0.5
    min_visible_fraction: float = 0.4
    min_diameter_m: float = 0.035
    max_diameter_m: float = 0.17
    treat_hidden: bool = True

    def __post_init__(self) -> None:
        if not 0.0 <= self.sure_confidence <= 1.0:
            raise ValueError("sure_confidence must lie in 0..1")
        if not (0.0 <= self.min_confidence <= 1.0 and 0.0 <= self.min_visible_fraction <= 1.0):
            raise ValueError("min_confidence and min_visible_fraction must lie in 0..1")
        if not 0.0 < self.min_diameter_m < self.max_diameter_m < math.inf:
            raise ValueError("need 0 < min_diameter_m < max_diameter_m")


@dataclass(frozen=True, slots=True)
class Verdict:
    """``wanted``, or else the state that the target deserves (NOT_WANTED, DOUBTFUL) and why."""

    wanted: bool
    state: TargetState
    reason: str


def wanted(target: Target, policy: Policy) -> Verdict:
    """Judge a target by the policy: size and ripeness make it NOT_WANTED, thin evidence DOUBTFUL."""
    if target.ripeness not in policy.ripeness:
        return Verdict(False, TargetState.NOT_WANTED, f"{target.ripeness.value} fruit is not treated")
    size_mm = 1e3 * target.diameter_m
    margin_m = 0.0 if target.measured else target.diameter_sigma_m
    if target.diameter_m + margin_m < policy.min_diameter_m:
        return Verdict(
            False, TargetState.NOT_WANTED, f"{size_mm:.0f} mm is below the least {1e3 * policy.min_diameter_m:.0f} mm"
        )
    if target.diameter_m - margin_m > policy.max_diameter_m:
        return Verdict(
            False, TargetState.NOT_WANTED, f"{size_mm:.0f} mm is above the most {1e3 * policy.max_diameter_m:.0f} mm"
        )
    if target.confidence < policy.min_confidence:
        return Verdict(
            False,
            TargetState.DOUBTFUL,
            f"confidence {target.confidence:.2f} is below {policy.min_confidence:.2f}",
        )
    if target.sightings < 2 and target.confidence < policy.sure_confidence:
        return Verdict(
            False,
            TargetState.DOUBTFUL,
            f"seen once, with confidence {target.confidence:.2f} below {policy.sure_confidence:.2f}",
        )
    if not (target.measured or policy.treat_hidden):
        return Verdict(False, TargetState.DOUBTFUL, TOO_HIDDEN)
    if target.visible_fraction < policy.min_visible_fraction:
        return Verdict(
            False,
            TargetState.DOUBTFUL,
            f"{100 * target.visible_fraction:.0f} % visible is below {100 * policy.min_visible_fraction:.0f} %",
        )
    return Verdict(True, TargetState.OPEN, "")

"""What one target is due, by its size, its ripeness, and how well it was seen."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum

from robot.dosing.factor import RipenessFactors
from robot.dosing.law import DoseLaw
from robot.dosing.values import Due, Refusal
from robot.targets import TOO_HIDDEN, Target
from robot.vision.values import Ripeness


class Hidden(StrEnum):
    """What becomes of a fruit that is too hidden to measure."""

    SKIP = "skip"  # no dose
    MINIMUM = "minimum"  # the law's least dose: what every fruit is due at least
    ESTIMATE = "estimate"  # the dose of its estimated diameter less one sigma


@dataclass(frozen=True, slots=True)
class DoseRules:
    """The law, what ripeness makes of it, and what is done without a measured size."""

    law: DoseLaw
    factors: RipenessFactors
    hidden: Hidden

    def dose_ml(self, diameter_m: float, ripeness: Ripeness) -> float:
        """What a fruit of known size and class gets, inside minimum and maximum; 0 when its class is not treated."""
        if ripeness not in self.factors.treated:
            return 0.0
        return self.law.within(self.factors.of(ripeness) * self.law.due_ml(diameter_m))


def due(target: Target, rules: DoseRules) -> Due | Refusal:
    """What the rules ask for a target, before minimum, maximum and caps."""
    if not (0.0 < target.diameter_m < math.inf and 0.0 <= target.diameter_sigma_m < math.inf):
        return Refusal(f"the fruit has no usable diameter ({target.diameter_m} m, sigma {target.diameter_sigma_m} m)")
    if target.ripeness not in rules.factors.treated:
        return Refusal(f"{target.ripeness.value} fruit is not treated")
    factor = rules.factors.at(target.ripeness, target.ripeness_score)
    if target.measured:
        return Due(factor * rules.law.due_ml(target.diameter_m), factor, "")
    if rules.hidden is Hidden.SKIP:
        return Refusal(TOO_HIDDEN)
    if rules.hidden is Hidden.MINIMUM:
        return Due(rules.law.min_ml, 1.0, f"{TOO_HIDDEN}: minimum dose")
    surely_m = max(0.0, target.diameter_m - target.diameter_sigma_m)
    reason = f"{TOO_HIDDEN}: dose of {1e3 * surely_m:.0f} mm, estimated {1e3 * target.diameter_m:.0f} less a sigma"
    return Due(factor * rules.law.due_ml(surely_m), factor, reason)

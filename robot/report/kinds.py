"""What fruit of each ripeness got, as the robot itself knows it."""

from __future__ import annotations

import math
from dataclasses import dataclass

from robot.report.evidence import Evidence
from robot.targets import TOO_HIDDEN, Target, TargetState
from robot.vision.values import Ripeness


@dataclass(frozen=True, slots=True)
class Kind:
    """One ripeness. ``hidden`` are those of the ``sprayed`` that were too hidden to measure when they got their dose.

    ``ml_per_cm3`` is of the other ``sprayed``, None without any; ``factors`` are the least and the greatest of their
    shots.
    """

    ripeness: Ripeness
    found: int
    sprayed: int
    hidden: int
    booked_ml: float
    ml_per_cm3: float | None
    factors: tuple[float, float] | None


def kinds(evidence: Evidence) -> tuple[Kind, ...]:
    """Red, turning and green, as far as any was found. Doses by hand have no fruit and do not count."""
    booked_ml: dict[int, float] = {}
    factors: dict[int, float] = {}  # of the targets that were measured when they got their dose
    for shot in evidence.shots:
        ml = shot.result.booked_ml if shot.result is not None else shot.intent.full_ml
        booked_ml[shot.intent.target_id] = booked_ml.get(shot.intent.target_id, 0.0) + ml
        if not shot.intent.reason.startswith(TOO_HIDDEN):
            factors[shot.intent.target_id] = shot.intent.factor
    found = [target for target in evidence.targets if target.confidence > 0.0]
    return tuple(
        _kind(ripeness, fruits, booked_ml, factors)
        for ripeness in Ripeness
        if (fruits := [target for target in found if target.ripeness is ripeness])
    )


def _kind(ripeness: Ripeness, fruits: list[Target], booked_ml: dict[int, float], factors: dict[int, float]) -> Kind:
    sprayed = [t for t in fruits if t.state in (TargetState.SPRAYED, TargetState.UNCERTAIN)]
    measured = [target for target in sprayed if target.id in factors]
    cm3 = sum(math.pi / 6.0 * (100.0 * target.diameter_m) ** 3 for target in measured)
    used = [factors[target.id] for target in measured]
    return Kind(
        ripeness=ripeness,
        found=len(fruits),
        sprayed=len(sprayed),
        hidden=len(sprayed) - len(measured),
        booked_ml=sum(booked_ml.get(target.id, 0.0) for target in fruits),
        ml_per_cm3=sum(booked_ml.get(target.id, 0.0) for target in measured) / cm3 if measured else None,
        factors=(min(used), max(used)) if used else None,
    )

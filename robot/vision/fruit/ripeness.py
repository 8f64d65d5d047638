"""Classes of the continuous ripeness score."""

from __future__ import annotations

from robot.vision.values import Ripeness

TURNING_FROM, RED_FROM = 0.25, 0.75


def kind_of(score: float) -> Ripeness:
    """The class of a score of 0 (green) to 1 (red)."""
    if score < TURNING_FROM:
        return Ripeness.GREEN
    return Ripeness.TURNING if score < RED_FROM else Ripeness.RED

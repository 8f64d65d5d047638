"""Sightings for the tests."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from robot.targets import Sighting
from robot.vision.values import Ripeness

# Mostly along the viewing direction (row y), as a stereo camera errs.
SCORES = {Ripeness.GREEN: 0.0, Ripeness.TURNING: 0.5, Ripeness.RED: 1.0}
COVARIANCE = np.diag([0.004**2, 0.012**2, 0.004**2])


def seen(
    x_m: float,
    y_m: float = 0.6,
    z_m: float = 0.9,
    diameter_m: float = 0.07,
    confidence: float = 0.9,
    visible: float = 0.9,
    ripeness: Ripeness = Ripeness.RED,
    score: float | None = None,
    measured: bool = True,
    diameter_sigma_m: float = 0.003,
    covariance: npt.NDArray[np.float64] = COVARIANCE,
) -> Sighting:
    return Sighting(
        centre_m=np.array([x_m, y_m, z_m]),
        covariance_m2=covariance,
        diameter_m=diameter_m,
        diameter_sigma_m=diameter_sigma_m,
        ripeness=ripeness,
        ripeness_score=SCORES[ripeness] if score is None else score,
        confidence=confidence,
        visible_fraction=visible,
        measured=measured,
    )

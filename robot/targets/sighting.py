"""A fruit of one frame, in the row frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from robot.geometry import Transform
from robot.vision.values import Fruit, Ripeness


@dataclass(frozen=True, slots=True, eq=False)
class Sighting:
    """As ``vision.Fruit``, moved to the row frame: ``centre_m`` (3,) and its ``covariance_m2`` (3, 3)."""

    centre_m: npt.NDArray[np.float64]
    covariance_m2: npt.NDArray[np.float64]
    diameter_m: float
    diameter_sigma_m: float
    ripeness: Ripeness
    ripeness_score: float
    confidence: float
    visible_fraction: float
    measured: bool


def sighting(fruit: Fruit, row_from_camera: Transform) -> Sighting:
    """Move a fruit from the left camera's optical frame to the row frame (pose at the frame's stamp)."""
    return Sighting(
        centre_m=row_from_camera.apply(fruit.centre_m),
        covariance_m2=row_from_camera.rotate_covariance(fruit.covariance_m2),
        diameter_m=fruit.diameter_m,
        diameter_sigma_m=fruit.diameter_sigma_m,
        ripeness=fruit.ripeness,
        ripeness_score=fruit.ripeness_score,
        confidence=fruit.confidence,
        visible_fraction=fruit.visible_fraction,
        measured=fruit.measured,
    )

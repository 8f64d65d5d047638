"""What vision finds."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np
import numpy.typing as npt


class Ripeness(StrEnum):
    RED = "red"
    TURNING = "turning"
    GREEN = "green"


@dataclass(frozen=True, slots=True)
class Circle:
    """A fruit in one image: centre and radius in pixels of the image as stored."""

    u_px: float
    v_px: float
    r_px: float
    ripeness: Ripeness
    confidence: float


@dataclass(frozen=True, slots=True, eq=False)
class Fruit:
    """A fruit in space.

    ``centre_m`` (3,) in the left camera's optical frame; ``covariance_m2`` (3, 3) of that centre; ``diameter_m`` of the
    sphere of equal volume with one-sigma ``diameter_sigma_m``; ``ripeness_score`` from 0 (green) to 1 (red);
    ``confidence`` 0..1 that it is a fruit; ``left`` and ``right`` are its outlines in the stored images;
    ``visible_fraction`` is the share of its outline that was seen. ``measured`` says that enough of the outline was
    seen in both views to measure position and size; when False the fruit is there, but ``centre_m`` and
    ``diameter_m`` are estimates, as wide as ``covariance_m2`` and ``diameter_sigma_m`` say.
    """

    centre_m: npt.NDArray[np.float64]
    covariance_m2: npt.NDArray[np.float64]
    diameter_m: float
    diameter_sigma_m: float
    ripeness: Ripeness
    ripeness_score: float
    confidence: float
    visible_fraction: float
    measured: bool
    left: Circle
    right: Circle

"""How far off a measured fruit may be: the fit's own covariance, what its model leaves out, and a doubtful outline.

The constants were set so that 93 to 98 % of the errors lie inside two sigmas, on the training scenes and the twin's
and, as a check, on the held-out ones.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from robot.vision.fruit.measure import Traced
from robot.vision.fruit.rectify import ParallelPair

Array = npt.NDArray[np.float64]
ALONG_SCALE, ACROSS_SCALE, SIZE_SCALE = 3.5, 4.0, 4.5
"""Neighbouring edge points share their errors: the fit's sigmas are too small by these factors."""
DISPARITY_SIGMA_PX, ACROSS_SIGMA_PX = 0.12, 0.3
"""Stored pixels; what the shape, the calibration and the lens model leave out."""
SHAPE_SIGMA = 0.006
DOUBTFUL_CENTRE, DOUBTFUL_SIZE = 0.12, 0.14
"""Shares of the diameter by which centre and size are off (one sigma) when the outline was not measured well."""


@dataclass(frozen=True, slots=True, eq=False)
class Spread:
    """Of n fruit: covariance ``centre_m2`` (n, 3, 3) in the pair's frame, one sigma ``diameter_m`` (n,)."""

    centre_m2: Array
    diameter_m: Array


def spread_of(traced: Traced, measured_well: Array, pair: ParallelPair) -> Spread:
    """``measured_well`` (n,) is the verifier's chance of that."""
    fit = traced.fit
    diameter = 2 * fit.volume_radius_m
    distance = np.linalg.norm(fit.centre_m, axis=1)
    axis = fit.centre_m / distance[:, None]
    along = axis[:, :, None] * axis[:, None, :]
    across = np.eye(3) - along
    depth_sigma = DISPARITY_SIGMA_PX * fit.centre_m[:, 2] ** 2 / (pair.focal_px * pair.baseline_m)
    across_sigma = ACROSS_SIGMA_PX * distance / pair.focal_px
    doubt = (1 - measured_well) ** 2
    wider = ALONG_SCALE * along + ACROSS_SCALE * across
    out = wider @ fit.covariance[:, :3, :3] @ wider
    out = out + along * (depth_sigma**2)[:, None, None] + across * (across_sigma**2)[:, None, None]
    out = out + along * (doubt * (DOUBTFUL_CENTRE * diameter) ** 2)[:, None, None]
    out = out + across * (doubt * (0.3 * DOUBTFUL_CENTRE * diameter) ** 2)[:, None, None]
    variance = 4 * SIZE_SCALE**2 * fit.covariance[:, 3, 3] + (SHAPE_SIGMA * diameter) ** 2
    variance = variance + doubt * (DOUBTFUL_SIZE * diameter) ** 2
    return Spread(np.asarray(0.5 * (out + out.transpose(0, 2, 1))), np.asarray(np.sqrt(variance)))

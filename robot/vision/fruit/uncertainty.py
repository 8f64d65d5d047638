"""How far off a measured fruit may be: the fit's own covariance, what its model leaves out, and a doubtful outline.

The constants were set on rendered scenes that the verifier was not trained on, so that squared errors divided by the
covariance have the median of a chi-square.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from robot.vision.fruit.joint_fit import Spheroids
from robot.vision.fruit.rectify import ParallelPair

Array = npt.NDArray[np.float64]
FIT_SCALE = 4.0
"""Neighbouring edge points share their errors: the fit knows about a quarter of what it believes."""
DISPARITY_SIGMA_PX, ACROSS_SIGMA_PX = 0.12, 0.15
"""Working pixels; lobes, calyx and shadows that a spheroid does not have."""
SHAPE_SIGMA = 0.012
DOUBTFUL_CENTRE, DOUBTFUL_SIZE = 0.12, 0.14
"""Shares of the diameter by which centre and size are off (one sigma) when the outline was not measured well."""


def centre_covariances(fit: Spheroids, measured_well: Array, pair: ParallelPair) -> Array:
    """(n, 3, 3) of the centres in the pair's frame; ``measured_well`` (n,) is the verifier's chance of that."""
    distance = np.linalg.norm(fit.centre_m, axis=1)
    axis = fit.centre_m / distance[:, None]
    along = axis[:, :, None] * axis[:, None, :]
    across = np.eye(3) - along
    depth_sigma = DISPARITY_SIGMA_PX * fit.centre_m[:, 2] ** 2 / (pair.focal_px * pair.baseline_m)
    across_sigma = ACROSS_SIGMA_PX * distance / pair.focal_px
    doubt = (1 - measured_well) * (DOUBTFUL_CENTRE * 2 * fit.radius_m) ** 2
    out = FIT_SCALE * fit.covariance[:, :3, :3]
    out = out + along * (depth_sigma**2)[:, None, None] + across * (across_sigma**2)[:, None, None]
    out = out + np.eye(3) * doubt[:, None, None]
    return np.asarray(0.5 * (out + out.transpose(0, 2, 1)))


def diameter_sigmas(fit: Spheroids, measured_well: Array) -> Array:
    """(n,) one-sigma of the diameters, metres."""
    diameter = 2 * fit.volume_radius_m
    fitted = FIT_SCALE * 4 * fit.covariance[:, 3, 3]
    doubt = (1 - measured_well) * (DOUBTFUL_SIZE * diameter) ** 2
    return np.asarray(np.sqrt(fitted + (SHAPE_SIGMA * diameter) ** 2 + doubt))

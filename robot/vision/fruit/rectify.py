"""One virtual pair of parallel cameras: points are rectified, not pixels."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from robot.vision.stereo_rig import StereoRig

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class ParallelPair:
    """Two pinholes of focal length ``focal_px`` and common principal point (cu, cv), in pixels.

    ``rect_from_left`` (3, 3) turns the left camera frame into the pair's; the right eye stands at (baseline_m, 0, 0).
    """

    focal_px: float
    cu: float
    cv: float
    baseline_m: float
    rect_from_left: Array
    rect_from_right: Array

    @property
    def eyes_m(self) -> Array:
        """(2, 3) positions of the two eyes in the pair's frame."""
        return np.array([[0.0, 0.0, 0.0], [self.baseline_m, 0.0, 0.0]])


def parallel_pair(rig: StereoRig) -> ParallelPair:
    """The virtual pair of a rig, at its resolution. ``ValueError`` unless the right eye is to the right of the left."""
    eye = -rig.R.T @ rig.t_m
    baseline = float(np.linalg.norm(eye))
    if not baseline > 0 or eye[0] < 0.7 * baseline:
        raise ValueError(
            f"expected the right camera to the right of the left one, found it at {np.round(eye, 4).tolist()} m; "
            "check the calibration's t_m and which image is left"
        )
    x = eye / baseline
    forward = np.array([0.0, 0.0, 1.0]) + rig.R[2]
    z = forward - x * (forward @ x)
    z /= np.linalg.norm(z)
    rect_from_left = np.stack([x, np.cross(z, x), z])
    focal, cu, cv = (float(rig.K_left[at] + rig.K_right[at]) / 2 for at in ((0, 0), (0, 2), (1, 2)))
    return ParallelPair(focal, cu, cv, baseline, rect_from_left, rect_from_left @ rig.R.T)

"""One virtual pair of parallel cameras at working resolution."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from robot.vision.fruit.planes import Plane
from robot.vision.stereo_rig import StereoRig

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class ParallelPair:
    """Two pinholes of focal length ``focal_px`` and common principal point (cu, cv), in working pixels.

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

    def rays(self, points_px: npt.ArrayLike) -> Array:
        """(..., 2) working pixels to unit rays (..., 3)."""
        p = np.asarray(points_px, dtype=np.float64)
        x, y = (p[..., 0] - self.cu) / self.focal_px, (p[..., 1] - self.cv) / self.focal_px
        out = np.stack([x, y, np.ones_like(x)], axis=-1)
        return np.asarray(out / np.linalg.norm(out, axis=-1, keepdims=True))


def parallel_pair(rig: StereoRig, working_size: tuple[int, int]) -> ParallelPair:
    """The virtual pair of a rig. Raises ``ValueError`` unless the right eye is to the right of the left one."""
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
    scale_x, scale_y = rig.image_size[0] / working_size[0], rig.image_size[1] / working_size[1]
    K_left, K_right = rig.K_left, rig.K_right
    focal = float((K_left[0, 0] + K_right[0, 0]) / (2 * scale_x))
    cu = float((K_left[0, 2] + K_right[0, 2] + 1) / (2 * scale_x) - 0.5)
    cv_ = float((K_left[1, 2] + K_right[1, 2] + 1) / (2 * scale_y) - 0.5)
    return ParallelPair(focal, cu, cv_, baseline, rect_from_left, rect_from_left @ rig.R.T)


def rectified(light: Plane, pair: ParallelPair, rect_from_camera: Array, K: Array, dist: Array, scale: Array) -> Plane:
    """Working light (h, w, 3) as the virtual camera sees it; ``scale`` (2,) stored pixels per working pixel."""
    K_working = K.copy()
    K_working[0] /= scale[0]
    K_working[1] /= scale[1]
    K_working[:2, 2] = (K[:2, 2] + 0.5) / scale - 0.5
    K_virtual = np.array([[pair.focal_px, 0, pair.cu], [0, pair.focal_px, pair.cv], [0, 0, 1.0]])
    size = (light.shape[1], light.shape[0])
    map_u, map_v = cv2.initUndistortRectifyMap(K_working, dist, rect_from_camera, K_virtual, size, cv2.CV_32FC1)
    return np.asarray(cv2.remap(light, map_u, map_v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE))

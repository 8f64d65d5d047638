"""The calibrated stereo pair: pixels to rays and back."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class StereoRig:
    """Two pinhole cameras with OpenCV distortion (k1 k2 p1 p2 k3).

    ``x_right = R @ x_left + t_m``, metres, optical frames; pixel centres at integers; ``image_size`` (width, height);
    ``K_*`` (3, 3); ``dist_*`` (5,); ``world_from_left`` (4, 4) or None.
    """

    image_size: tuple[int, int]
    K_left: Array
    K_right: Array
    dist_left: Array
    dist_right: Array
    R: Array
    t_m: Array
    world_from_left: Array | None = None

    @property
    def baseline_m(self) -> float:
        return float(np.linalg.norm(self.t_m))

    @property
    def P_left(self) -> Array:
        """(3, 4): left-frame metres to undistorted left pixels, eq. 4."""
        return np.asarray(self.K_left @ np.eye(3, 4), dtype=np.float64)

    @property
    def P_right(self) -> Array:
        """(3, 4): left-frame metres to undistorted right pixels, eq. 5."""
        return np.asarray(self.K_right @ np.column_stack([self.R, self.t_m]), dtype=np.float64)

    def undistort_left(self, points_px: npt.ArrayLike) -> Array:
        """(n, 2) pixels of the stored left image to undistorted pixels of the same camera matrix."""
        return _undistort(points_px, self.K_left, self.dist_left)

    def undistort_right(self, points_px: npt.ArrayLike) -> Array:
        """(n, 2) pixels of the stored right image to undistorted pixels of the same camera matrix."""
        return _undistort(points_px, self.K_right, self.dist_right)

    def project_left(self, points_m: npt.ArrayLike) -> Array:
        """(n, 3) points of the left frame to pixels (n, 2) of the stored left image."""
        return _project(points_m, np.eye(3), np.zeros(3), self.K_left, self.dist_left)

    def project_right(self, points_m: npt.ArrayLike) -> Array:
        """(n, 3) points of the left frame to pixels (n, 2) of the stored right image."""
        return _project(points_m, self.R, self.t_m, self.K_right, self.dist_right)


def _undistort(points_px: npt.ArrayLike, K: Array, dist: Array) -> Array:
    stored = np.asarray(points_px, dtype=np.float64).reshape(-1, 2)
    if len(stored) == 0:
        return stored
    rays = cv2.undistortPoints(stored.reshape(-1, 1, 2), K, dist).reshape(-1, 2).astype(np.float64)
    focal = np.array([K[0, 0], K[1, 1]])
    for _ in range(4):  # OpenCV stops after five coarse steps; go on to 1e-6 px
        back = _project(np.column_stack([rays, np.ones(len(rays))]), np.eye(3), np.zeros(3), K, dist)
        rays += (stored - back) / focal
    return np.asarray(rays * focal + K[:2, 2] + np.column_stack([K[0, 1] * rays[:, 1], np.zeros(len(rays))]))


def _project(points_m: npt.ArrayLike, R: Array, t_m: Array, K: Array, dist: Array) -> Array:
    points = np.asarray(points_m, dtype=np.float64).reshape(-1, 3)
    if len(points) == 0:
        return np.zeros((0, 2))
    rotation_vector, _ = cv2.Rodrigues(R)
    out, _ = cv2.projectPoints(points, rotation_vector, np.asarray(t_m, dtype=np.float64), K, dist)
    return np.asarray(out, dtype=np.float64).reshape(-1, 2)

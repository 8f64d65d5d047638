"""The true stereo optics of the twin: points to pixels and pixels to rays, by its own arithmetic."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Eye:
    """One pinhole camera with lens distortion k1 k2 p1 p2 k3 (Brown 1966); pixel centres at integers.

    ``eye_from_left``: rotation R (3, 3) and translation t_m (3,) from the left optical frame.
    """

    K: Array
    dist: Array
    R: Array
    t_m: Array

    @property
    def centre_m(self) -> Array:
        """The optical centre in the left optical frame (3,)."""
        return np.asarray(-self.R.T @ self.t_m)

    def project(self, points_m: npt.ArrayLike) -> Array:
        """(n, 3) points of the left optical frame to pixels (n, 2); points behind the eye give nan."""
        inside = np.asarray(points_m, dtype=np.float64).reshape(-1, 3) @ self.R.T + self.t_m
        depth = np.where(inside[:, 2:] > 1e-6, inside[:, 2:], np.nan)
        return self.pixels(inside[:, :2] / depth)

    def pixels(self, rays: npt.ArrayLike) -> Array:
        """(n, 2) undistorted normalised coordinates x/z, y/z of the eye to pixels (n, 2)."""
        flat = np.asarray(rays, dtype=np.float64).reshape(-1, 2)
        bent = _bend(flat, self.dist)
        return np.column_stack(
            [
                self.K[0, 0] * bent[:, 0] + self.K[0, 1] * bent[:, 1] + self.K[0, 2],
                self.K[1, 1] * bent[:, 1] + self.K[1, 2],
            ]
        )

    def rays(self, pixels: npt.ArrayLike) -> Array:
        """(n, 2) pixels to undistorted normalised coordinates, by Newton's method to 1e-12."""
        flat = np.asarray(pixels, dtype=np.float64).reshape(-1, 2)
        y = (flat[:, 1] - self.K[1, 2]) / self.K[1, 1]
        bent = np.column_stack([(flat[:, 0] - self.K[0, 2] - self.K[0, 1] * y) / self.K[0, 0], y])
        if not np.any(self.dist):
            return bent
        straight = bent.copy()
        step = 1e-6
        along_x, along_y = np.array([step, 0.0]), np.array([0.0, step])
        for _ in range(20):
            error = _bend(straight, self.dist) - bent
            if np.max(np.abs(error), initial=0.0) < 1e-12:
                break
            dx = (_bend(straight + along_x, self.dist) - _bend(straight - along_x, self.dist)) / (2 * step)
            dy = (_bend(straight + along_y, self.dist) - _bend(straight - along_y, self.dist)) / (2 * step)
            det = dx[:, 0] * dy[:, 1] - dy[:, 0] * dx[:, 1]
            straight[:, 0] -= (dy[:, 1] * error[:, 0] - dy[:, 0] * error[:, 1]) / det
            straight[:, 1] -= (dx[:, 0] * error[:, 1] - dx[:, 1] * error[:, 0]) / det
        return straight


@dataclass(frozen=True, slots=True, eq=False)
class StereoOptics:
    """The true pair: ``x_right = R x_left + t_m`` (metres); ``image_size`` (width, height); ``dist_*`` k1 k2 p1 p2 k3.

    Raises ``ValueError`` when a matrix has the wrong shape or the image size is not positive.
    """

    image_size: tuple[int, int]
    K_left: Array
    K_right: Array
    dist_left: Array
    dist_right: Array
    R: Array
    t_m: Array

    def __post_init__(self) -> None:
        expected = {
            "K_left": (3, 3), "K_right": (3, 3), "dist_left": (5,), "dist_right": (5,), "R": (3, 3), "t_m": (3,),
        }  # fmt: skip
        for name, shape in expected.items():
            found = np.shape(getattr(self, name))
            if found != shape:
                raise ValueError(f"optics.{name}: expected shape {shape}, found {found}; correct the calibration")
        if min(self.image_size) < 16 or any(size % 2 for size in self.image_size):
            raise ValueError(f"optics.image_size: expected even and at least 16, found {self.image_size}; correct it")

    @property
    def left(self) -> Eye:
        return Eye(self.K_left, self.dist_left, np.eye(3), np.zeros(3))

    @property
    def right(self) -> Eye:
        return Eye(self.K_right, self.dist_right, self.R, self.t_m)


def _bend(rays: Array, dist: Array) -> Array:
    """Lens distortion of normalised coordinates (n, 2)."""
    if not np.any(dist):
        return rays
    k1, k2, p1, p2, k3 = dist
    x, y = rays[:, 0], rays[:, 1]
    r2 = x * x + y * y
    radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
    return np.column_stack(
        [
            x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
            y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
        ]
    )

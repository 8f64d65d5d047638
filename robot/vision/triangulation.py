"""A point in space from its two images, section 3.4.3 of the paper."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


def triangulate(P_left: Array, P_right: Array, left_px: npt.ArrayLike, right_px: npt.ArrayLike) -> Array:
    """Points (n, 3), metres in the frame of the projection matrices (3, 4), from undistorted pixels (n, 2) each.

    Eq. 6 multiplied out gives four equations a point, A P = b (eq. 7), with A of eq. 8, P of eq. 9 and b of eq. 10;
    least squares gives P = (A'A)^-1 A'b (eq. 11). Parallel rays have no such point: NaN.
    """
    A, b = linear_equations(P_left, P_right, left_px, right_px)
    normal = np.swapaxes(A, 1, 2) @ A
    right_side = np.swapaxes(A, 1, 2) @ b[:, :, None]
    out = np.full((len(A), 3), np.nan)
    scale = np.trace(normal, axis1=1, axis2=2) / 3.0
    solvable = np.linalg.det(normal) > 1e-15 * scale**3
    out[solvable] = np.linalg.solve(normal[solvable], right_side[solvable])[:, :, 0]
    return out


def linear_equations(
    P_left: Array, P_right: Array, left_px: npt.ArrayLike, right_px: npt.ArrayLike
) -> tuple[Array, Array]:
    """A (n, 4, 3) of eq. 8 and b (n, 4) of eq. 10, from eq. 4 to 6 with the unknown scales z_l, z_r eliminated."""
    rows = []
    sides = []
    for P, points in ((P_left, left_px), (P_right, right_px)):
        pixels = np.asarray(points, dtype=np.float64).reshape(-1, 2)
        for axis in (0, 1):
            equation = pixels[:, axis, None] * P[2] - P[axis]
            rows.append(equation[:, :3])
            sides.append(-equation[:, 3])
    return np.stack(rows, axis=1), np.stack(sides, axis=1)


def point_covariance(P_left: Array, P_right: Array, point_m: npt.ArrayLike, sigma_px: float) -> Array:
    """Covariance (3, 3) in m^2 of a triangulated point whose four pixel coordinates each err by ``sigma_px``.

    First order: (J'J)^-1 sigma^2 with J the Jacobian of eq. 6.
    """
    homogeneous = np.append(np.asarray(point_m, dtype=np.float64), 1.0)
    jacobian = []
    for P in (P_left, P_right):
        u_w, v_w, w = P @ homogeneous
        jacobian.append((P[0, :3] - u_w / w * P[2, :3]) / w)
        jacobian.append((P[1, :3] - v_w / w * P[2, :3]) / w)
    J = np.array(jacobian)
    return np.asarray(np.linalg.inv(J.T @ J) * sigma_px**2)

"""Position, size and flattening of a fruit from its outlines in both views at once.

The outline of a sphere is its tangent cone: a ray on it makes the angle asin(R / |S - eye|) with the direction of the
centre S. Fitting that in both views has no depth bias of -R^2/Z as triangulated outline centres have. A second harmonic
of the radius, shared by both views, takes up the flattening of real fruit.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
FLATTENING_PRIOR = (0.05, 0.04)
SKEW_SIGMA = 0.03
ITERATIONS = 5


@dataclass(frozen=True, slots=True, eq=False)
class Spheroids:
    """n fitted fruit: ``centre_m`` (n, 3), ``radius_m`` (n,) mean outline radius, ``harmonic`` (n, 2), ``covariance``
    (n, 4, 4) of x, y, z and radius in m^2, ``residual_px`` (n, 2, k), ``weights`` (n, 2, k) and ``scale`` (n,), by
    how much the residuals exceed their sigmas."""

    centre_m: Array
    radius_m: Array
    harmonic: Array
    covariance: Array
    residual_px: Array
    weights: Array
    scale: Array

    def __getitem__(self, rows: npt.NDArray[np.int64]) -> Spheroids:
        """Some of the fruit."""
        return Spheroids(*(getattr(self, field.name)[rows] for field in fields(self)))

    @property
    def volume_radius_m(self) -> Array:
        """(n,) radius of the sphere of equal volume: a body of revolution about the shorter axis of its outline."""
        return np.asarray(self.radius_m * (1.0 + self.harmonic[:, 0] / 3.0))


def fit_spheroids(
    rays: Array, sigma_px: Array, eyes_m: Array, start: Array, harmonic: Array, focal_px: float,
    iterations: int = ITERATIONS,
) -> Spheroids:  # fmt: skip
    """Fit n fruit to unit ``rays`` (n, 2, k, 3) of the outline points in two views, each known to ``sigma_px``
    (n, 2, k), pixels of ``focal_px``.

    ``eyes_m`` (2, 3); ``start`` (n, 4) x, y, z, radius; ``harmonic`` (n, 2) to start from. Gauss-Newton with Tukey
    weights of the residuals in their sigmas.
    """
    count = len(start)
    points = rays.shape[1] * rays.shape[2]
    state = np.zeros((count, 6))
    state[:, :3] = start[:, :3]
    state[:, 3] = np.log(start[:, 3])
    state[:, 4:] = harmonic
    residual, jacobian = _residuals(state, rays, eyes_m, focal_px)
    normal = np.tile(np.eye(6), (count, 1, 1))
    weights = np.ones_like(residual)
    scale = np.ones(count)
    for k in range(iterations):
        relative = residual / sigma_px
        floor = max(1.0, 2.0 - 0.5 * k)
        scale = np.maximum(1.4826 * np.median(np.abs(relative).reshape(count, points), axis=1), floor)
        weights = np.clip(1 - (relative / (4.0 * scale[:, None, None])) ** 2, 0.0, None) ** 2
        information = (weights / (sigma_px * scale[:, None, None]) ** 2).reshape(count, points, 1)
        transposed = (jacobian * information).transpose(0, 2, 1)
        normal = transposed @ jacobian
        gradient = (transposed @ residual.reshape(count, points, 1))[..., 0]
        _add_priors(normal, gradient, state)
        step = np.linalg.solve(normal, gradient[..., None])[..., 0]
        limit = np.column_stack([np.tile(0.15 * state[:, 2:3], (1, 3)), np.full((count, 3), 0.2)])
        state -= np.clip(step, -limit, limit)
        state[:, 2] = np.clip(state[:, 2], 0.1, 5.0)
        state[:, 3] = np.clip(state[:, 3], np.log(0.005), np.log(0.5))
        state[:, 4:] = np.clip(state[:, 4:], -0.25, 0.25)
        residual, jacobian = _residuals(state, rays, eyes_m, focal_px)
    covariance = np.linalg.inv(normal)[:, :4, :4]
    radius = np.exp(state[:, 3])
    to_radius = np.ones((count, 4))
    to_radius[:, 3] = radius
    covariance = covariance * to_radius[:, :, None] * to_radius[:, None, :]
    return Spheroids(state[:, :3].copy(), radius, state[:, 4:].copy(), covariance, residual, weights, scale)


def _add_priors(normal: Array, gradient: Array, state: Array) -> None:
    for index, mean, sigma in ((4, FLATTENING_PRIOR[0], FLATTENING_PRIOR[1]), (5, 0.0, SKEW_SIGMA)):
        normal[:, index, index] += 1 / sigma**2
        gradient[:, index] += (state[:, index] - mean) / sigma**2
    normal += np.diag([1e-2, 1e-2, 1e-2, 1.0, 1e-6, 1e-6])


def _residuals(state: Array, rays: Array, eyes_m: Array, focal_px: float) -> tuple[Array, Array]:
    """The angle of each ray to the centre minus the tangent cone's, (n, 2, k) pixels, and its Jacobian (n, 2 k, 6).

    With p = S - eye, n = p / |p|, t the unit vector across n towards the ray and s = R (1 + a cos + b sin) / |p|:
    d(angle)/dS = -t / |p| and d(asin s)/dS = -tan(asin s) n / |p|.
    """
    distance, right, down, axis = _looking_at(state[:, :3], eyes_m)
    local = rays @ np.stack([right, down, axis], axis=-1)
    across, below, along = local[..., 0], local[..., 1], local[..., 2]
    length = np.sqrt(across * across + below * below) + 1e-12
    cosine, sine_turn = across / length, below / length
    cos2, sin2 = cosine * cosine - sine_turn * sine_turn, 2 * cosine * sine_turn
    size = (np.exp(state[:, 3])[:, None] / distance)[..., None]
    sine = np.clip(size * (1 + state[:, 4, None, None] * cos2 + state[:, 5, None, None] * sin2), 1e-6, 0.95)
    residual = (np.arctan2(length, along) - np.arcsin(sine)) * focal_px
    secant = 1 / np.sqrt(1 - sine * sine)
    jacobian = np.empty((*residual.shape, 6))
    outward = cosine[..., None] * right[:, :, None] + sine_turn[..., None] * down[:, :, None]
    jacobian[..., :3] = ((sine * secant)[..., None] * axis[:, :, None] - outward) / distance[..., None, None]
    jacobian[..., 3] = -sine * secant
    jacobian[..., 4] = -size * secant * cos2
    jacobian[..., 5] = -size * secant * sin2
    jacobian *= focal_px
    return residual, jacobian.reshape(len(state), rays.shape[1] * rays.shape[2], 6)


def _looking_at(centre_m: Array, eyes_m: Array) -> tuple[Array, Array, Array, Array]:
    """For each fruit and eye the distance (n, 2) and unit vectors (n, 2, 3) right, down and towards the centre."""
    to_centre = centre_m[:, None] - eyes_m[None]
    distance = np.sqrt((to_centre**2).sum(axis=2))
    axis = to_centre / distance[..., None]
    x, y, z = axis[..., 0], axis[..., 1], axis[..., 2]
    level = np.sqrt(x * x + z * z) + 1e-12
    right = np.stack([z / level, np.zeros_like(x), -x / level], axis=-1)
    down = np.stack([-x * y / level, level, -y * z / level], axis=-1)
    return distance, right, down, axis


def outline_rays(
    centre_m: Array, radius_m: Array, harmonic: Array, eyes_m: Array, turn_rad: Array, beyond_rad: Array
) -> Array:
    """Unit rays (n, 2, k, m, 3) at the k angles ``turn_rad`` (from right to down), ``beyond_rad`` outside the outline,
    of a shape that broadcasts to (n, 2, k, m)."""
    distance, right, down, axis = _looking_at(centre_m, eyes_m)
    shape = 1 + harmonic[:, :1] * np.cos(2 * turn_rad) + harmonic[:, 1:] * np.sin(2 * turn_rad)
    sine = np.clip(radius_m[:, None, None] * shape[:, None] / distance[..., None], 1e-6, 0.95)
    angle = np.arcsin(sine)[..., None] + beyond_rad
    outward = np.cos(turn_rad)[:, None] * right[:, :, None] + np.sin(turn_rad)[:, None] * down[:, :, None]
    return np.asarray(
        np.cos(angle)[..., None] * axis[:, :, None, None] + np.sin(angle)[..., None] * outward[:, :, :, None]
    )

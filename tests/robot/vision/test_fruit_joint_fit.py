"""The joint fit against geometry worked out by hand."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

from robot.vision.fruit.joint_fit import fit_spheroids

Array = npt.NDArray[np.float64]
FOCAL_PX = 457.0
EYES_M = np.array([[0.0, 0.0, 0.0], [0.06, 0.0, 0.0]])
ANGLES = 64


def tangent_rays(centre_m: Array, radius_m: float) -> Array:
    """Unit rays (1, 2, ANGLES, 3) along the tangent cones of a sphere, straight from the definition of a tangent."""
    out = []
    for eye in EYES_M:
        to_centre = centre_m - eye
        distance = np.linalg.norm(to_centre)
        axis = to_centre / distance
        across = np.cross([0.0, 1.0, 0.0], axis)
        across /= np.linalg.norm(across)
        down = np.cross(axis, across)
        turn = np.arange(ANGLES) * 2 * np.pi / ANGLES
        touch_m = np.sqrt(distance**2 - radius_m**2)
        touching = (
            axis * touch_m**2 / distance
            + (np.cos(turn)[:, None] * across + np.sin(turn)[:, None] * down) * touch_m * radius_m / distance
        )
        out.append(touching / np.linalg.norm(touching, axis=1, keepdims=True))
    return np.array(out)[None]


def start_near(centre_m: Array, radius_m: float) -> Array:
    return np.array([[*(centre_m * 1.08), radius_m * 0.9]])


@pytest.mark.parametrize(
    ("centre_m", "radius_m"),
    [((0.0, 0.0, 0.3), 0.07), ((0.15, -0.1, 0.5), 0.035), ((-0.2, 0.12, 0.8), 0.045)],
)
def test_a_sphere_is_located_without_the_depth_bias_of_outline_centres(
    centre_m: tuple[float, float, float], radius_m: float
) -> None:
    centre = np.array(centre_m)
    fit = fit_spheroids(
        tangent_rays(centre, radius_m),
        np.ones((1, 2, ANGLES)),
        EYES_M,
        start_near(centre, radius_m),
        np.zeros((1, 2)),
        FOCAL_PX,
    )
    assert np.abs(fit.centre_m[0] - centre).max() < 0.4e-3
    assert fit.radius_m[0] == pytest.approx(radius_m, rel=2e-3)


def test_a_quarter_of_the_outline_hidden_by_a_leaf_moves_the_fruit_less_than_a_millimetre() -> None:
    centre, radius_m = np.array([0.05, 0.02, 0.5]), 0.04
    rays = tangent_rays(centre, radius_m)
    axis = centre / np.linalg.norm(centre)
    rays[0, 0, 10:26] += 0.15 * (axis - rays[0, 0, 10:26])
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    fit = fit_spheroids(rays, np.ones((1, 2, ANGLES)), EYES_M, start_near(centre, radius_m), np.zeros((1, 2)), FOCAL_PX)
    assert np.linalg.norm(fit.centre_m[0] - centre) < 1e-3
    assert fit.weights[0, 0, 10:26].max() < 0.05


def test_the_covariance_is_as_large_as_the_scatter_of_repeated_measurements() -> None:
    generator = np.random.default_rng(5)
    centre, radius_m = np.array([0.05, 0.02, 0.6]), 0.04
    count, sigma_px = 150, 0.6
    rays = np.repeat(tangent_rays(centre, radius_m), count, axis=0)
    rays += generator.normal(0.0, sigma_px / FOCAL_PX, rays.shape)
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    start = np.repeat(start_near(centre, radius_m), count, axis=0)
    fit = fit_spheroids(
        rays, np.full((count, 2, ANGLES), sigma_px), EYES_M, start, np.zeros((count, 2)), FOCAL_PX
    )
    error = fit.centre_m - centre
    squared = np.einsum("ni,nij,nj->n", error, np.linalg.inv(fit.covariance[:, :3, :3]), error)
    assert 2.0 < squared.mean() < 5.0, "the mean of a chi-square of three degrees of freedom is 3"


def test_depth_is_the_least_certain_direction() -> None:
    centre, radius_m = np.array([0.0, 0.0, 0.7]), 0.04
    fit = fit_spheroids(
        tangent_rays(centre, radius_m),
        np.ones((1, 2, ANGLES)),
        EYES_M,
        start_near(centre, radius_m),
        np.zeros((1, 2)),
        FOCAL_PX,
    )
    sigma = np.sqrt(np.diagonal(fit.covariance[0])[:3])
    assert sigma[2] > 5 * max(sigma[0], sigma[1])


def test_a_flattened_fruit_is_given_the_diameter_of_the_sphere_of_equal_volume() -> None:
    equatorial_m, polar_m = 0.045, 0.036
    centre = np.array([0.0, 0.0, 0.6])
    turn = np.arange(720) * 2 * np.pi / 720
    rays = []
    for eye in EYES_M:
        to_centre = centre - eye
        # tangent cone of a spheroid: rays where the discriminant of the intersection vanishes
        shape = np.diag([1 / equatorial_m**2, 1 / polar_m**2, 1 / equatorial_m**2])
        cone = np.outer(shape @ to_centre, shape @ to_centre) - (to_centre @ shape @ to_centre - 1) * shape
        axis = to_centre / np.linalg.norm(to_centre)
        across = np.cross([0.0, 1.0, 0.0], axis)
        across /= np.linalg.norm(across)
        down = np.cross(axis, across)
        outward = np.cos(turn)[:, None] * across + np.sin(turn)[:, None] * down
        a = np.einsum("ki,ij,kj->k", outward, cone, outward)
        b = np.einsum("ki,ij,j->k", outward, cone, axis)
        c = axis @ cone @ axis
        tangent = (-b - np.sqrt(b * b - a * c)) / a
        ray = axis + np.abs(tangent)[:, None] * outward
        rays.append((ray / np.linalg.norm(ray, axis=1, keepdims=True))[:: 720 // 60])
    measured = np.array(rays)[None]
    start = start_near(centre, equatorial_m)
    fit = fit_spheroids(measured, np.ones((1, 2, 60)), EYES_M, start, np.zeros((1, 2)), FOCAL_PX)
    true_m = (equatorial_m**2 * polar_m) ** (1 / 3)
    assert fit.volume_radius_m[0] == pytest.approx(true_m, rel=0.01)
    assert np.linalg.norm(fit.centre_m[0] - centre) < 2e-3

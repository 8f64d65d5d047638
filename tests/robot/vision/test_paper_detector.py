"""The paper's method as a whole, on spheres whose place and size are known."""

from __future__ import annotations

import math

import numpy as np
import pytest

from robot.vision.make import make_detector
from robot.vision.paper import PaperDetector, PaperParameters, sphere_volume_m3
from robot.vision.values import Ripeness
from tests.robot.vision.spheres import LEAF_BGR, Ball, photograph, small_rig

NEAR = Ball((-0.08, 0.03, 0.40), 0.09)
FAR = Ball((0.13, -0.06, 0.50), 0.10)


@pytest.mark.parametrize("reading", ["binary", "laplacian"])
@pytest.mark.parametrize("tilted", [False, True])
def test_two_red_spheres_are_found_where_they_are_and_as_large_as_they_are(tilted: bool, reading: str) -> None:
    rig = small_rig(tilted)
    detector = PaperDetector(PaperParameters(reading=reading))  # type: ignore[arg-type]
    fruits = detector.detect(*photograph([NEAR, FAR], rig), rig)
    assert len(fruits) == 2
    for fruit, ball in zip(fruits, (NEAR, FAR), strict=True):
        distance_m = math.dist(ball.centre_m, (0, 0, 0))
        bias_m = (ball.diameter_m / 2.0) ** 2 / distance_m  # outline centres lie too near by R^2 / d
        pixel_m = distance_m**2 / (rig.K_left[0, 0] * rig.baseline_m)  # of one pixel of disparity
        assert float(np.linalg.norm(fruit.centre_m - ball.centre_m)) < bias_m + 1.2 * pixel_m
        assert fruit.diameter_m == pytest.approx(ball.diameter_m, abs=3.0 * distance_m / rig.K_left[0, 0])
        assert fruit.ripeness is Ripeness.RED
        assert 0.8 < fruit.confidence <= 1.0
        assert fruit.visible_fraction > 0.9
        assert fruit.measured


def test_a_sphere_half_behind_a_leaf_is_found_and_not_measured() -> None:
    rig = small_rig(tilted=False)
    x_m, y_m, z_m = NEAR.centre_m
    leaf = Ball((x_m - 0.2, y_m, z_m - 0.1), 0.4, LEAF_BGR)
    (fruit,) = PaperDetector().detect(*photograph([NEAR, leaf], rig), rig)
    assert fruit.diameter_m < 0.7 * NEAR.diameter_m
    assert 0.5 < fruit.visible_fraction < 0.7
    assert not fruit.measured


def test_outlines_are_in_pixels_of_the_stored_images() -> None:
    rig = small_rig(tilted=True)
    (fruit,) = PaperDetector().detect(*photograph([NEAR], rig), rig)
    left, right = rig.project_left([NEAR.centre_m])[0], rig.project_right([NEAR.centre_m])[0]
    assert (fruit.left.u_px, fruit.left.v_px) == pytest.approx(tuple(left), abs=2.0)
    assert (fruit.right.u_px, fruit.right.v_px) == pytest.approx(tuple(right), abs=2.0)


def test_covariance_covers_the_error_and_is_longest_along_the_line_of_sight() -> None:
    rig = small_rig(tilted=False)
    (fruit,) = PaperDetector().detect(*photograph([FAR], rig), rig)
    error = fruit.centre_m - FAR.centre_m
    assert float(error @ np.linalg.solve(fruit.covariance_m2, error)) < 9.0
    values, vectors = np.linalg.eigh(fruit.covariance_m2)
    assert values[0] > 0.0
    assert abs(vectors[2, 2]) > 0.95
    assert fruit.diameter_sigma_m > 0.0


def test_a_sphere_beyond_the_admitted_distance_is_left_out() -> None:
    rig = small_rig(tilted=False)
    images = photograph([NEAR, FAR], rig)
    near_only = PaperDetector(PaperParameters(max_distance_m=0.44)).detect(*images, rig)
    assert [round(float(fruit.centre_m[2]), 1) for fruit in near_only] == [0.4]


def test_a_sphere_seen_by_one_camera_alone_has_no_range_and_is_left_out() -> None:
    rig = small_rig(tilted=False)
    left, _ = photograph([NEAR], rig)
    _, leaves_alone = photograph([], rig)
    assert PaperDetector().detect(left, leaves_alone, rig) == ()


def test_a_green_sphere_among_green_leaves_stays_unseen() -> None:
    rig = small_rig(tilted=False)
    green = Ball(NEAR.centre_m, NEAR.diameter_m, (50, 150, 60))
    assert PaperDetector().detect(*photograph([green], rig), rig) == ()


@pytest.mark.parametrize(
    ("colour_bgr", "ripeness"),
    [((30, 40, 190), Ripeness.RED), ((40, 105, 190), Ripeness.TURNING), ((130, 100, 100), Ripeness.GREEN)],
)
def test_ripeness_follows_the_mean_colour_inside_the_circle(
    colour_bgr: tuple[int, int, int], ripeness: Ripeness
) -> None:
    image, _ = photograph([Ball(NEAR.centre_m, NEAR.diameter_m, colour_bgr)], small_rig(tilted=False))
    (circle,) = PaperDetector().detect_mono(image)
    assert circle.ripeness is ripeness


def test_a_single_image_of_any_size_gives_circles() -> None:
    image, _ = photograph([NEAR, FAR], small_rig(tilted=False))
    circles = PaperDetector().detect_mono(image[20:221, 11:])
    assert [circle.ripeness for circle in circles] == [Ripeness.RED, Ripeness.RED]
    assert circles[0].u_px < circles[1].u_px


def test_an_image_of_another_size_than_the_rig_is_refused() -> None:
    rig = small_rig(tilted=False)
    left, right = photograph([NEAR], rig)
    with pytest.raises(ValueError, match="right image is 310x240, the rig is calibrated for 320x240"):
        PaperDetector().detect(left, right[:, 10:], rig)


@pytest.mark.parametrize("shape", [(240, 320), (240, 320, 4), (0, 320, 3)])
def test_an_image_that_is_not_colour_is_refused(shape: tuple[int, ...]) -> None:
    with pytest.raises(ValueError, match="uint8 in BGR"):
        PaperDetector().detect_mono(np.zeros(shape, dtype=np.uint8))


def test_noise_gives_few_and_finite_circles() -> None:
    noise = np.random.default_rng(3).integers(0, 256, (240, 320, 3), dtype=np.uint8)
    circles = PaperDetector().detect_mono(noise)
    assert len(circles) < 5
    assert all(math.isfinite(value) for circle in circles for value in (circle.u_px, circle.v_px, circle.r_px))


def test_volume_is_that_of_a_sphere() -> None:
    assert sphere_volume_m3(0.1) == pytest.approx(523.599e-6, rel=1e-5)


def test_the_baseline_is_had_by_its_configured_name() -> None:
    assert isinstance(make_detector("paper"), PaperDetector)


def test_an_unknown_detector_name_is_refused() -> None:
    with pytest.raises(ValueError, match="'paper' or 'fruit', found 'deep'"):
        make_detector("deep")  # type: ignore[arg-type]

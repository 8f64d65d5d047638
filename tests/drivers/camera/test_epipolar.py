"""A decalibration of one pixel is seen, its axis told, and none is seen where there is none."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest
from scipy.spatial.transform import Rotation

from drivers.camera.epipolar import Misalignment, Rectifier, StereoCalibration, Verdict, misalignment
from drivers.camera.view_matching import Matches

Array = npt.NDArray[np.float64]

K = np.array([[457.0, 0.0, 319.5], [0.0, 457.0, 239.5], [0.0, 0.0, 1.0]])
DIST = np.array([-0.1, 0.02, 0.0, 0.0, 0.0])
PIXEL_RAD = 1.0 / 457.0


def judged(turn_rad: tuple[float, float, float], count: int, noise_px: float, wrong: int = 0) -> Misalignment:
    """Points before a calibrated pair whose right eye has turned since; the last ``wrong`` are mismatched."""
    rng = np.random.default_rng(5)
    pixels = np.column_stack([rng.uniform(150, 630, count), rng.uniform(20, 460, count)])
    points_m = np.column_stack([(pixels - K[:2, 2]) / 457.0, np.ones(count)]) * rng.uniform(0.35, 1.0, (count, 1))
    in_right = (points_m - np.array([0.06, 0.0, 0.0])) @ Rotation.from_rotvec(turn_rad).as_matrix()
    left, right = (project(points) + rng.normal(0.0, noise_px, (count, 2)) for points in (points_m, in_right))
    right[count - wrong :] += rng.uniform(-12.0, 12.0, (wrong, 2))
    calibration = StereoCalibration((640, 480), K, DIST, K, DIST, np.eye(3), np.array([-0.06, 0.0, 0.0]))
    rectify = Rectifier(calibration)
    return misalignment(*rectify(Matches(left, right)), rectify.focal_px)


def project(points_m: Array) -> Array:
    ray = points_m[:, :2] / points_m[:, 2:]
    square = np.sum(ray**2, axis=1, keepdims=True)
    return np.asarray(ray * (1.0 + DIST[0] * square + DIST[1] * square**2) * 457.0 + K[:2, 2])


@pytest.mark.parametrize("wrong", [0, 12])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_one_pixel_of_pitch_is_decalibrated_and_told(sign: float, wrong: int) -> None:
    found = judged((sign * PIXEL_RAD, 0.0, 0.0), 120, 0.3, wrong)
    assert found.verdict() is Verdict.DECALIBRATED
    assert found.shift_px == pytest.approx(1.05, abs=0.12)
    assert found.pitch_rad == pytest.approx(sign * PIXEL_RAD, abs=0.15 * PIXEL_RAD)
    assert f"rows {found.shift_px:.2f} px off" in str(found)


@pytest.mark.parametrize("wrong", [0, 12])
def test_a_true_calibration_holds(wrong: int) -> None:
    found = judged((0.0, 0.0, 0.0), 120, 0.3, wrong)
    assert found.verdict() is Verdict.HOLDS
    assert found.shift_px < 0.15


def test_a_large_turn_about_the_vertical_is_told_though_rows_hardly_show_it() -> None:
    found = judged((0.0, 6.0 * PIXEL_RAD, 0.0), 300, 0.2)
    assert found.disparity_px == pytest.approx(6.0, abs=4.0 * found.disparity_sigma_px)
    assert found.shift_px < 0.8
    assert found.verdict(limit_px=1.0) is Verdict.DECALIBRATED


def test_sigmas_are_those_of_the_errors() -> None:
    noisy = judged((0.0, 0.0, 0.0), 60, 0.6)
    assert 0.1 < noisy.shift_sigma_px < 0.3
    assert judged((0.0, 0.0, 0.0), 240, 0.6).shift_sigma_px == pytest.approx(noisy.shift_sigma_px / 2.0, rel=0.35)


def test_few_points_and_much_noise_cannot_tell() -> None:
    assert judged((PIXEL_RAD, 0.0, 0.0), 20, 0.2).verdict() is Verdict.UNSURE
    assert judged((PIXEL_RAD, 0.0, 0.0), 40, 2.0).verdict() is Verdict.UNSURE

"""The shift of the pose from fruits that were seen before."""

from __future__ import annotations

import numpy as np
import pytest

from robot.navigation import LandmarkRules, estimate_shift


def test_a_pose_too_far_ahead_sees_fruit_too_far_ahead_and_is_set_back() -> None:
    shift = estimate_shift([(0.012, -0.004), (0.011, -0.003), (0.013, -0.005), (0.012, -0.004)])
    assert shift is not None
    assert (shift.dx_m, shift.dy_m) == pytest.approx((-0.012, 0.004))
    assert shift.landmarks == 4


def test_a_wrong_match_does_not_move_the_pose() -> None:
    offsets = [(0.012, 0.0, 0.0), (0.011, 0.0, 0.0), (0.013, 0.0, 0.0), (0.012, 0.0, 0.0), (-0.08, 0.05, 0.0)]
    shift = estimate_shift(offsets)
    assert shift is not None
    assert shift.landmarks == 4
    assert shift.dx_m == pytest.approx(-0.012)


@pytest.mark.parametrize("count", [0, 1, 2])
def test_too_few_landmarks_say_nothing(count: int) -> None:
    assert estimate_shift([(0.01, 0.0)] * count) is None


def test_landmarks_without_figures_do_not_count() -> None:
    assert estimate_shift([(0.01, 0.0), (0.01, 0.0), (float("nan"), 0.0)]) is None


def test_landmarks_that_disagree_altogether_say_nothing() -> None:
    offsets = [(0.0, 0.0), (0.001, 0.3), (0.3, 0.001), (0.3, -0.3)]
    assert estimate_shift(offsets, LandmarkRules(outlier_sigmas=0.1)) is None


def test_claimed_error_covers_the_true_one() -> None:
    rng = np.random.default_rng(5)
    inside = 0
    for _ in range(400):
        shift = estimate_shift(list(rng.normal(0.0, 0.008, (6, 2))))
        assert shift is not None
        inside += abs(shift.dx_m) < 2.0 * shift.sigma_x_m
    assert inside >= 0.95 * 400


def test_more_landmarks_make_a_smaller_error_down_to_the_floor() -> None:
    rng = np.random.default_rng(6)
    few = estimate_shift(list(rng.normal(0.0, 0.008, (6, 2))))
    many = estimate_shift(list(rng.normal(0.0, 0.008, (60, 2))))
    exact = estimate_shift([(0.01, 0.0)] * 50)
    assert few is not None
    assert many is not None
    assert exact is not None
    assert many.sigma_x_m < few.sigma_x_m
    assert exact.sigma_x_m == LandmarkRules().floor_m

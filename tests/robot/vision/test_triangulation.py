"""Section 3.4: matching by row and least squares from the two projection matrices."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robot.vision.matching import match_by_row, rectified
from robot.vision.triangulation import linear_equations, point_covariance, triangulate
from tests.robot.vision.spheres import small_rig

# x and y follow z: points that both cameras see
Point = st.tuples(st.floats(-0.5, 0.6), st.floats(-0.5, 0.5), st.floats(0.2, 2.0)).map(
    lambda seen: (seen[0] * seen[2], seen[1] * seen[2], seen[2])
)
RIG = small_rig(tilted=True)
POINTS_M = np.array([[0.1, -0.05, 0.5], [-0.2, 0.1, 0.8], [0.0, 0.0, 0.3]])


def undistorted(points_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    homogeneous = np.column_stack([points_m, np.ones(len(points_m))])
    left, right = homogeneous @ RIG.P_left.T, homogeneous @ RIG.P_right.T
    return left[:, :2] / left[:, 2:], right[:, :2] / right[:, 2:]


@given(point=Point)
def test_a_projected_point_comes_back_exactly(point: tuple[float, float, float]) -> None:
    left, right = undistorted(np.array([point]))
    assert triangulate(RIG.P_left, RIG.P_right, left, right)[0] == pytest.approx(point, abs=1e-8)


@given(point=Point)
def test_the_true_point_satisfies_the_equations_7_to_10(point: tuple[float, float, float]) -> None:
    A, b = linear_equations(RIG.P_left, RIG.P_right, *undistorted(np.array([point])))
    assert A[0] @ np.array(point) == pytest.approx(b[0], abs=1e-9)


def test_points_stored_by_distorting_cameras_come_back_through_undistortion() -> None:
    left = RIG.undistort_left(RIG.project_left(POINTS_M))
    right = RIG.undistort_right(RIG.project_right(POINTS_M))
    assert triangulate(RIG.P_left, RIG.P_right, left, right) == pytest.approx(POINTS_M, abs=1e-6)


def test_parallel_rays_have_no_point() -> None:
    rig = small_rig(tilted=False)
    assert np.isnan(triangulate(rig.P_left, rig.P_right, [[100.0, 90.0]], [[100.0, 90.0]])).all()


def test_no_points_give_no_points() -> None:
    none = np.zeros((0, 2))
    assert triangulate(RIG.P_left, RIG.P_right, none, none).shape == (0, 3)


def test_covariance_agrees_with_the_scatter_of_noisy_pixels() -> None:
    rng = np.random.default_rng(5)
    point = POINTS_M[:1]
    left, right = undistorted(np.repeat(point, 4000, axis=0))
    noisy = [view + rng.normal(0.0, 0.2, view.shape) for view in (left, right)]
    scatter = np.cov(triangulate(RIG.P_left, RIG.P_right, noisy[0], noisy[1]).T)
    assert np.sqrt(np.diag(point_covariance(RIG.P_left, RIG.P_right, point[0], 0.2))) == pytest.approx(
        np.sqrt(np.diag(scatter)), rel=0.1
    )


@given(point=Point)
def test_rectified_rows_of_one_point_agree_and_disparity_gives_its_depth(point: tuple[float, float, float]) -> None:
    left, right = rectified(RIG, RIG.project_left([point]), RIG.project_right([point]))
    assert left[0, 1] == pytest.approx(right[0, 1], abs=1e-3)
    focal_px = float(np.mean([RIG.K_left[0, 0], RIG.K_left[1, 1], RIG.K_right[0, 0], RIG.K_right[1, 1]]))
    depth_m = focal_px * RIG.baseline_m / (left[0, 0] - right[0, 0])
    assert depth_m == pytest.approx(point[2], rel=0.06)  # the rectified axis is tilted against the camera's


def test_nearest_rows_are_matched_first_and_each_point_once() -> None:
    left = np.array([[100.0, 50.0], [110.0, 52.0]])
    right = np.array([[60.0, 51.8], [70.0, 49.0]])
    assert match_by_row(left, right, 3.0, (1.0, 100.0)) == [(0, 1), (1, 0)]


def test_rows_too_far_apart_and_impossible_disparities_are_no_match() -> None:
    left = np.array([[100.0, 50.0]])
    assert match_by_row(left, np.array([[60.0, 54.0]]), 3.0, (1.0, 100.0)) == []
    assert match_by_row(left, np.array([[120.0, 50.0]]), 3.0, (1.0, 100.0)) == []
    assert match_by_row(left, np.zeros((0, 2)), 3.0, (1.0, 100.0)) == []

from __future__ import annotations

import numpy as np
import pytest

from robot.aiming import Box, Capsule, Sphere
from robot.aiming.capsules import capsule_distance_m, segment_box_m, segment_point_m, segment_segment_m
from robot.geometry import transform_from_xyz_rpy

SHARES = np.linspace(0.0, 1.0, 301)[:, None]


def _segments(seed: int, count: int) -> tuple[np.ndarray, np.ndarray]:
    random = np.random.default_rng(seed)
    return random.normal(0.0, 0.4, (count, 3)), random.normal(0.0, 0.4, (count, 3))


def _points(start: np.ndarray, end: np.ndarray) -> np.ndarray:
    return start + SHARES * (end - start)


def test_segment_distances_are_the_least_over_all_pairs_of_points() -> None:
    (a0, a1), (b0, b1) = _segments(1, 40), _segments(2, 40)
    exact = segment_segment_m(a0, a1, b0, b1)
    for k in range(40):
        grid = np.linalg.norm(_points(a0[k], a1[k])[:, None] - _points(b0[k], b1[k]), axis=-1).min()
        assert exact[k] <= grid + 1e-12
        assert exact[k] == pytest.approx(grid, abs=0.01)


def test_crossing_segments_touch() -> None:
    x, y = np.array([1.0, 0, 0]), np.array([0, 1.0, 0])
    assert segment_segment_m(-x, x, -y, y) == pytest.approx(0.0, abs=1e-12)


def test_parallel_segments_side_by_side_are_as_far_as_their_lines() -> None:
    x, up = np.array([1.0, 0, 0]), np.array([0, 0, 0.3])
    assert segment_segment_m(0 * x, x, up + 0.5 * x, up + 3 * x) == pytest.approx(0.3)


def test_collinear_segments_are_as_far_as_their_near_ends() -> None:
    x = np.array([1.0, 0, 0])
    assert segment_segment_m(0 * x, x, 3 * x, 1.5 * x) == pytest.approx(0.5)


def test_segments_without_length_are_points() -> None:
    a, b = np.array([0.0, 0, 0]), np.array([0.3, 0.4, 0])
    assert segment_segment_m(a, a, b, b) == pytest.approx(0.5)
    assert segment_point_m(a, a, b) == pytest.approx(0.5)


def test_point_distances_end_at_the_segment_ends() -> None:
    x = np.array([1.0, 0, 0])
    assert segment_point_m(0 * x, x, 2 * x) == pytest.approx(1.0)
    assert segment_point_m(0 * x, x, np.array([0.5, 0.2, 0.0])) == pytest.approx(0.2)


def test_box_distances_are_the_least_over_all_points_of_the_segment() -> None:
    box = Box(transform_from_xyz_rpy((0.1, 0.2, -0.1), (0.3, -0.2, 0.9)), np.array([0.1, 0.25, 0.05]))
    start, end = _segments(3, 200)
    exact = segment_box_m(start, end, box)
    for k in range(200):
        inside_frame = box.pose.inverse().apply(_points(start[k], end[k]))
        grid = np.linalg.norm(inside_frame - np.clip(inside_frame, -box.half_m, box.half_m), axis=-1).min()
        assert exact[k] <= grid + 1e-12
        assert exact[k] == pytest.approx(grid, abs=0.01)


def test_a_segment_through_a_box_has_no_distance() -> None:
    box = Box(transform_from_xyz_rpy((0, 0, 0), (0, 0, 0)), np.array([0.1, 0.1, 0.1]))
    assert segment_box_m(np.array([-1.0, 0, 0]), np.array([1.0, 0.05, 0]), box) == 0.0


def test_a_segment_along_a_face_keeps_its_height_over_it() -> None:
    box = Box(transform_from_xyz_rpy((0, 0, 0), (0, 0, 0)), np.array([0.1, 0.1, 0.1]))
    assert segment_box_m(np.array([-1.0, 0, 0.3]), np.array([1.0, 0, 0.3]), box) == pytest.approx(0.2)


def test_overlapping_capsules_have_a_negative_gap() -> None:
    x = np.array([1.0, 0, 0])
    assert capsule_distance_m(Capsule(0 * x, x, 0.2), Capsule(2 * x, 1.3 * x, 0.2)) == pytest.approx(-0.1)


def test_moving_both_keeps_the_gap() -> None:
    (a0, b0), (a1, b1) = _segments(5, 2), _segments(6, 2)
    one, two = Capsule(a0[0], a1[0], 0.1), Capsule(b0[1], b1[1], 0.05)
    move = transform_from_xyz_rpy((1.0, 2.0, 3.0), (0.4, 0.5, 0.6))
    assert capsule_distance_m(one.moved(move), two.moved(move)) == pytest.approx(capsule_distance_m(one, two))
    assert Sphere(a0[0], 0.1).moved(move).centre_m == pytest.approx(move.apply(a0[0]))

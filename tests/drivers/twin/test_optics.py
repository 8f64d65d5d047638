"""The twin projects by its own arithmetic and agrees with OpenCV's."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from drivers.twin.optics import StereoOptics
from tests.drivers.twin.greenhouses import bent_optics, ideal_optics

POINTS = np.random.default_rng(2).uniform([-0.3, -0.25, 0.4], [0.3, 0.25, 1.0], (50, 3))


def test_projection_agrees_with_opencv_in_both_eyes() -> None:
    optics = bent_optics()
    left, _ = cv2.projectPoints(POINTS, np.zeros(3), np.zeros(3), optics.K_left, optics.dist_left)
    turn, _ = cv2.Rodrigues(optics.R)
    right, _ = cv2.projectPoints(POINTS, turn, optics.t_m, optics.K_right, optics.dist_right)
    assert optics.left.project(POINTS) == pytest.approx(left.reshape(-1, 2), abs=1e-9)
    assert optics.right.project(POINTS) == pytest.approx(right.reshape(-1, 2), abs=1e-9)


def test_rays_undo_pixels() -> None:
    eye = bent_optics().right
    pixels = np.random.default_rng(3).uniform([0, 0], [639, 479], (100, 2))
    assert eye.pixels(eye.rays(pixels)) == pytest.approx(pixels, abs=1e-8)


def test_a_point_behind_the_eye_has_no_pixel() -> None:
    assert np.isnan(ideal_optics().left.project([[0.0, 0.0, -1.0]])).all()


def test_the_right_eye_stands_to_the_right() -> None:
    assert ideal_optics().right.centre_m == pytest.approx([0.06, 0.0, 0.0])


def test_a_matrix_of_the_wrong_shape_is_refused_by_name() -> None:
    K = np.eye(3)
    with pytest.raises(ValueError, match=r"optics.dist_left: expected shape \(5,\), found \(4,\)"):
        StereoOptics((640, 480), K, K, np.zeros(4), np.zeros(5), np.eye(3), np.zeros(3))

"""Steps I to VI of section 3.3.3: the centre from three points of the contour."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from robot.vision.paper import PaperParameters
from robot.vision.paper.regions import Region
from robot.vision.paper.three_points import circle_of, circumcentre, second_point, third_point

Angle = st.floats(0.0, math.tau)


def disc_region(centre: tuple[int, int], radius: int) -> Region:
    image = np.zeros((300, 300), dtype=np.uint8)
    cv2.circle(image, centre, radius, 255, cv2.FILLED)
    (contour, *_), _ = cv2.findContours(image, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    return Region(contour.reshape(-1, 2).astype(np.int64), float(cv2.contourArea(contour)), 1.0)


@given(u=st.floats(-500, 500), v=st.floats(-500, 500), r=st.floats(5, 300), a=Angle, b=Angle, c=Angle)
def test_bisectors_of_three_points_of_a_circle_cross_in_its_centre(
    u: float, v: float, r: float, a: float, b: float, c: float
) -> None:
    assume(min(abs(math.remainder(p - q, math.tau)) for p, q in ((a, b), (a, c), (b, c))) > 0.2)
    points = [(u + r * math.cos(angle), v + r * math.sin(angle)) for angle in (a, b, c)]
    assert circumcentre(*points) == pytest.approx([u, v], abs=1e-6 * (r + abs(u) + abs(v)))


@pytest.mark.parametrize("points", [[(0, 0), (1, 1), (2, 2)], [(0, 0), (0, 0), (3, 1)], [(5, 5), (5, 5), (5, 5)]])
def test_points_on_a_line_or_twice_the_same_have_no_circle(points: list[tuple[int, int]]) -> None:
    assert circumcentre(*points) is None


@pytest.mark.parametrize("radius", [15, 40, 100])
def test_circle_of_a_disc_is_the_disc_to_a_few_per_cent(radius: int) -> None:
    u, v, r = circle_of(disc_region((150, 140), radius), PaperParameters()) or (0.0, 0.0, 0.0)
    assert (u, v) == (pytest.approx(150, abs=0.05 * radius + 1.0), pytest.approx(140, abs=0.05 * radius + 1.0))
    assert r == pytest.approx(radius, rel=0.06)


def test_first_point_lies_on_the_circle_that_is_returned() -> None:
    region = disc_region((150, 140), 40)
    u, v, r = circle_of(region, PaperParameters()) or (0.0, 0.0, 0.0)
    distances = np.hypot(*(region.contour - [u, v]).T)
    assert np.min(np.abs(distances - r)) < 1e-9


def test_second_point_is_in_the_column_m_to_the_right_nearest_to_the_first() -> None:
    contour = np.array([[10, 10], [14, 12], [14, 30], [6, 14]])
    assert second_point(contour, contour[0], 4) == pytest.approx([14, 12])
    assert second_point(contour, contour[0], 5) is None


def test_third_point_is_in_the_row_n_below_first_met_to_the_left() -> None:
    contour = np.array([[10, 10], [14, 14], [7, 14], [2, 14]])
    assert third_point(contour, contour[0], 4) == pytest.approx([7, 14])
    assert third_point(contour, contour[0], 3) is None


def test_retries_with_shorter_skips_find_the_third_point_where_the_contour_is_broken() -> None:
    whole = disc_region((150, 140), 60)
    lost = (whole.contour[:, 0] < 150) & (whole.contour[:, 1] > 115)
    broken = Region(whole.contour[~lost], whole.area_px, whole.circularity)
    assert circle_of(broken, PaperParameters(retries=0)) is None
    assert circle_of(broken, PaperParameters(retries=10)) == pytest.approx((150, 140, 60), abs=4.0)


def test_a_contour_without_width_has_no_circle() -> None:
    line = Region(np.column_stack([np.arange(50), np.full(50, 7)]), 400.0, 1.0)
    assert circle_of(line, PaperParameters()) is None

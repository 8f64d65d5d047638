import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robot.navigation import Geofence

YARD = Geofence(((-1.0, -1.0), (5.0, -1.0), (5.0, 1.0), (-1.0, 1.0)))
L_SHAPE = Geofence(((0.0, 0.0), (4.0, 0.0), (4.0, 1.0), (1.0, 1.0), (1.0, 3.0), (0.0, 3.0)))


def test_the_margin_is_the_distance_to_the_nearest_side_negative_outside():
    assert YARD.margin_m(0.0, 0.0) == pytest.approx(1.0)
    assert YARD.margin_m(4.8, 0.0) == pytest.approx(0.2)
    assert YARD.margin_m(5.3, 0.0) == pytest.approx(-0.3)
    assert YARD.margin_m(6.0, 2.0) == pytest.approx(-math.sqrt(2.0))
    assert L_SHAPE.margin_m(2.0, 2.0) == pytest.approx(-1.0)
    assert L_SHAPE.margin_m(0.5, 2.0) == pytest.approx(0.5)
    assert L_SHAPE.area_m2 == pytest.approx(6.0)


def test_what_is_not_known_of_the_position_eats_the_margin():
    assert YARD.margin_m(0.0, 0.0, sigma_m=0.3) == pytest.approx(0.4)
    assert YARD.margin_m(4.5, 0.0, sigma_m=0.3) == pytest.approx(-0.1)


@given(st.floats(-2.0, 6.0), st.floats(-2.0, 4.0), st.integers(0, 5), st.booleans())
def test_the_margin_does_not_depend_on_where_the_corners_begin_or_which_way_they_run(x, y, shift, back):
    corners = L_SHAPE.corners[shift:] + L_SHAPE.corners[:shift]
    other = Geofence(corners[::-1] if back else corners)
    assert other.margin_m(x, y) == pytest.approx(L_SHAPE.margin_m(x, y), abs=1e-9)


@given(st.floats(-2.0, 6.0), st.floats(-2.0, 4.0), st.floats(-0.5, 0.5), st.floats(-0.5, 0.5))
def test_a_step_changes_the_margin_by_no_more_than_its_length(x, y, dx, dy):
    before, after = L_SHAPE.margin_m(x, y), L_SHAPE.margin_m(x + dx, y + dy)
    assert abs(after - before) <= math.hypot(dx, dy) + 1e-9


@pytest.mark.parametrize(
    ("corners", "words"),
    [
        (((0, 0), (1, 0)), "at least 3 corners, found 2"),
        (((0, 0), (4, 0), (float("nan"), 3)), "finite numbers"),
        (((0, 0), (4, 0), (4, 0), (0, 4)), "is there twice"),
        (((0, 0), (4, 4), (4, 0), (0, 4)), "crosses itself"),
        (((0, 0), (4, 0), (4, 2), (2, 0), (0, 2)), "crosses itself"),
        (((0, 0), (1, 0), (0, 0.5)), "encloses 0.250 m2"),
        (((0, 0), (2, 0), (4, 0)), "crosses itself|encloses"),
    ],
)
def test_what_is_no_polygon_is_refused_with_the_reason(corners, words):
    with pytest.raises(ValueError, match=words):
        Geofence(tuple((float(x), float(y)) for x, y in corners))

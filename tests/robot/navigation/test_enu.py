"""Latitude and longitude to the row frame."""

from __future__ import annotations

import math

import numpy as np
import pytest

from robot.navigation import Datum, enu_m, row_xy_m
from robot.navigation.enu import ecef_m


def test_earth_centred_coordinates_at_pole_and_equator_are_the_ellipsoids_axes() -> None:
    np.testing.assert_allclose(ecef_m(0.0, 0.0), [6378137.0, 0.0, 0.0], atol=1e-6)
    np.testing.assert_allclose(ecef_m(90.0, 0.0), [0.0, 0.0, 6356752.314245], atol=1e-5)


def test_one_second_of_latitude_is_30_9_m_north_at_48_degrees() -> None:
    east_m, north_m = enu_m(48.0 + 1 / 3600, 9.0, Datum(48.0, 9.0, 0.0))
    assert east_m == pytest.approx(0.0, abs=1e-6)
    assert north_m == pytest.approx(30.89, abs=0.01)


def test_one_second_of_longitude_is_shorter_by_the_cosine_of_latitude() -> None:
    datum = Datum(48.0, 9.0, 0.0)
    east_m, north_m = enu_m(48.0, 9.0 + 1 / 3600, datum)
    assert east_m == pytest.approx(20.73, abs=0.01)
    assert abs(north_m) < 1e-3


@pytest.mark.parametrize(
    ("heading_deg", "x_sign", "y_sign"),
    [(0.0, (0, 1), (-1, 0)), (90.0, (1, 0), (0, 1)), (180.0, (0, -1), (1, 0))],
)
def test_row_heading_turns_clockwise_from_north(
    heading_deg: float, x_sign: tuple[int, int], y_sign: tuple[int, int]
) -> None:
    datum = Datum(50.0, 8.0, math.radians(heading_deg))
    latitude, longitude = 50.0 + 2e-5, 8.0 + 1e-5
    east_m, north_m = enu_m(latitude, longitude, datum)
    x_m, y_m = row_xy_m(latitude, longitude, datum)
    assert x_m == pytest.approx(x_sign[0] * east_m + x_sign[1] * north_m, abs=1e-9)
    assert y_m == pytest.approx(y_sign[0] * east_m + y_sign[1] * north_m, abs=1e-9)


@pytest.mark.parametrize("figures", [(91.0, 0.0, 0.0), (0.0, 181.0, 0.0), (0.0, 0.0, float("nan"))])
def test_an_impossible_datum_is_refused(figures: tuple[float, float, float]) -> None:
    with pytest.raises(ValueError, match="datum"):
        Datum(*figures)

"""Light follows the sun."""

from __future__ import annotations

import math

import numpy as np
import pytest

from drivers.twin.light import light_at, rgb_of_colour_temperature, sun_position
from drivers.twin.plants import grow
from drivers.twin.renderer import DEFAULT_EXPOSURE_S, StereoRenderer
from drivers.twin.scene import Scene
from tests.drivers.twin.greenhouses import camera_at, ideal_optics


def test_the_sun_stands_highest_in_the_south_at_solar_noon() -> None:
    elevation, azimuth = sun_position(13.0)
    assert elevation == pytest.approx(math.radians(60.0))
    assert abs(azimuth) == pytest.approx(math.pi)


def test_the_sun_rises_in_the_east_and_sets_in_the_west() -> None:
    assert math.sin(sun_position(8.0)[1]) > 0.0
    assert math.sin(sun_position(18.0)[1]) < 0.0


def test_a_row_that_points_east_has_the_morning_sun_ahead() -> None:
    assert light_at(8.0, row_azimuth_rad=math.pi / 2).sun_direction[0] > 0.8


def test_the_direction_to_the_sun_is_a_unit_vector() -> None:
    for hour in range(8, 21):
        assert np.linalg.norm(light_at(hour).sun_direction) == pytest.approx(1.0)


def test_light_fades_from_noon_to_dusk() -> None:
    levels = [light_at(hour).sun_w_m2 + light_at(hour).sky_w_m2 for hour in (13, 15, 17, 18, 19, 19.5, 20)]
    assert levels == sorted(levels, reverse=True)
    assert levels[0] > 50.0 * levels[-1]


def test_clouds_leave_only_the_sky() -> None:
    overcast = light_at(12.0, "overcast")
    assert overcast.sun_w_m2 == 0.0
    assert overcast.sky_w_m2 > light_at(12.0).sky_w_m2


def test_the_low_sun_is_redder() -> None:
    assert light_at(19.5).sun_colour_k < light_at(12.0).sun_colour_k


def test_warm_light_has_more_red_than_blue() -> None:
    red, green, blue = rgb_of_colour_temperature(3000.0)
    assert red > green > blue
    assert rgb_of_colour_temperature(10000.0)[2] > rgb_of_colour_temperature(10000.0)[0]


def test_6500_kelvin_is_nearly_white() -> None:
    assert rgb_of_colour_temperature(6504.0) == pytest.approx([1.0, 1.0, 1.0], abs=0.06)


def test_an_hour_outside_the_day_is_refused() -> None:
    with pytest.raises(ValueError, match="hour: expected 0 to 24"):
        light_at(25.0)


def test_the_fixed_exposure_is_right_at_noon_and_nearly_black_at_twenty_hours() -> None:
    renderer = StereoRenderer(grow(Scene(seed=1)), ideal_optics(), 1)
    noon, _ = renderer.render(camera_at(1.0), light_at(12.0), DEFAULT_EXPOSURE_S)
    night, _ = renderer.render(camera_at(1.0), light_at(20.0), DEFAULT_EXPOSURE_S)
    assert 85.0 <= noon.mean() <= 125.0
    assert np.mean(noon == 255) < 0.01
    assert 3.5 <= night.mean() <= 9.0


def test_the_lamp_lights_the_night() -> None:
    renderer = StereoRenderer(grow(Scene(seed=1)), ideal_optics(), 1)
    dark, _ = renderer.render(camera_at(1.0), light_at(20.0))
    lit, _ = renderer.render(camera_at(1.0), light_at(20.0, lamp_on=True))
    assert lit.mean() > 3.0 * dark.mean()

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from robot.aiming import Sphere, stand_off_m
from robot.aiming.approach import spray_axes, spray_caught_by_others
from robot.aiming.stand_off import stand_offs_m
from tests.robot.aiming.rig import Rig


@pytest.mark.parametrize("diameter_m", [0.05, 0.08, 0.11])
def test_the_cone_covers_the_asked_share_of_the_fruit(rig: Rig, diameter_m: float) -> None:
    distance_m = stand_off_m(diameter_m, rig.parameters)
    spot_radius_m = distance_m * math.tan(rig.parameters.cone_half_angle_rad)
    assert spot_radius_m == pytest.approx(0.9 * diameter_m / 2, rel=0.02)


def test_a_wide_cone_stops_at_the_least_gap_to_the_skin(rig: Rig) -> None:
    wide = replace(rig.parameters, cone_half_angle_rad=math.radians(40.0))
    assert stand_off_m(0.08, wide) == pytest.approx(0.04 + 0.06)


def test_a_narrow_cone_stops_at_the_largest_stand_off(rig: Rig) -> None:
    narrow = replace(rig.parameters, cone_half_angle_rad=math.radians(2.0))
    assert stand_off_m(0.08, narrow) == narrow.max_stand_off_m


def test_shorter_stand_offs_follow_for_tight_places_and_keep_the_gap(rig: Rig) -> None:
    distances = stand_offs_m(0.10, rig.parameters)
    assert distances[0] == stand_off_m(0.10, rig.parameters)
    assert list(distances) == sorted(distances, reverse=True)
    assert min(distances) >= 0.05 + 0.06


@pytest.mark.parametrize("diameter_m", [0.0, -0.1, math.nan, math.inf])
def test_an_impossible_diameter_is_refused(rig: Rig, diameter_m: float) -> None:
    with pytest.raises(ValueError, match="diameter_m"):
        stand_off_m(diameter_m, rig.parameters)


def test_axes_fill_the_cap_about_the_preferred_one() -> None:
    axes = spray_axes(np.array([0.0, 2.0, 0.0]), math.radians(70.0), 49)
    assert axes[0] == pytest.approx([0, 1, 0])
    assert np.linalg.norm(axes, axis=1) == pytest.approx(1.0)
    off_rad = np.arccos(np.clip(axes @ axes[0], -1, 1))
    assert off_rad.max() == pytest.approx(math.radians(70.0))
    apart_rad = np.arccos(np.clip(axes @ axes.T - 2 * np.eye(49), -1, 1))
    assert apart_rad.min(axis=1).max() < math.radians(20.0)


def test_a_fruit_beside_the_cone_catches_nothing_and_one_in_it_all() -> None:
    nozzle, axis, distance = np.zeros((1, 3)), np.array([[1.0, 0, 0]]), np.array([0.2])
    beside, within, behind = ([0.1, 0.1, 0], [0.1, 0, 0], [0.3, 0, 0])

    def caught(centre: list[float]) -> float:
        other = Sphere(np.array(centre), 0.02)
        return float(spray_caught_by_others(nozzle, axis, distance, math.radians(15), (other,))[0])

    assert caught(beside) == 0.0
    assert caught(within) == 1.0
    assert caught(behind) == 0.0


def test_wrong_parameters_are_named(rig: Rig) -> None:
    with pytest.raises(ValueError, match="cone_fill: expected"):
        replace(rig.parameters, cone_fill=-1.0)
    with pytest.raises(ValueError, match="ready_rad: expected finite numbers"):
        replace(rig.parameters, ready_rad=(math.nan,) * 6)

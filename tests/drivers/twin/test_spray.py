"""Not a drop is lost, and it lands where it must."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.twin.plants import grow
from drivers.twin.scene import Scene
from drivers.twin.spray import deposit
from tests.drivers.twin.greenhouses import fruit, greenhouse, leaf

CONE = math.radians(15.0)
PLANTS = grow(Scene(seed=2, row_length_m=1.8))


@settings(max_examples=40, deadline=None)
@given(
    x=st.floats(-0.5, 2.3),
    y=st.floats(0.0, 0.6),
    z=st.floats(0.1, 1.6),
    yaw=st.floats(-math.pi, math.pi),
    pitch=st.floats(-1.5, 1.5),
    half=st.floats(0.02, 1.3),
    volume=st.floats(0.0, 50.0),
)
def test_the_parts_add_up_to_what_left_the_nozzle(
    x: float, y: float, z: float, yaw: float, pitch: float, half: float, volume: float
) -> None:
    axis = [math.cos(yaw) * math.cos(pitch), math.sin(yaw) * math.cos(pitch), math.sin(pitch)]
    parts = deposit(PLANTS, [x, y, z], axis, half, volume)
    assert parts.total_ml == pytest.approx(volume, abs=1e-9)
    assert min([*parts.fruit_ml.values(), parts.leaf_ml, parts.stem_ml, parts.soil_ml, parts.air_ml]) >= 0.0


def test_a_fruit_that_fills_the_cone_takes_all() -> None:
    parts = deposit(greenhouse(fruit((0, 0.6, 0.9), 0.10, 1.0, number=4)), [0, 0.45, 0.9], [0, 1, 0], CONE, 3.0)
    assert parts.fruit_ml == {4: pytest.approx(3.0)}


def test_a_leaf_before_the_fruit_takes_its_share() -> None:
    plants = greenhouse(fruit((0, 0.6, 0.9), 0.10, 1.0), leaves=leaf((0.0, 0.5, 0.9), 0.25))
    parts = deposit(plants, [0, 0.42, 0.9], [0, 1, 0], CONE, 3.0)
    assert parts.leaf_ml > 2.8
    assert sum(parts.fruit_ml.values()) < 0.2


def test_a_fruit_takes_the_share_of_the_cone_that_it_covers() -> None:
    """A sphere of angular radius b takes (1 - cos b) / (1 - cos a) of a full cone of half-angle a."""
    parts = deposit(greenhouse(fruit((0, 0.6, 0.9), 0.06, 1.0)), [0, 0.3, 0.9], [0, 1, 0], CONE, 1.0)
    expected = (1.0 - math.cos(math.asin(0.03 / 0.3))) / (1.0 - math.cos(CONE))
    assert parts.fruit_ml[1] == pytest.approx(expected, abs=0.01)


def test_what_passes_the_plants_is_lost_in_the_air() -> None:
    assert deposit(greenhouse(), [0, 0.4, 0.9], [0, 1, 0], CONE, 2.0).air_ml == pytest.approx(2.0)


def test_a_nozzle_that_points_down_wets_the_soil() -> None:
    assert deposit(greenhouse(), [0, 0.4, 0.5], [0, 0, -1], CONE, 2.0).soil_ml == pytest.approx(2.0)


def test_beyond_its_reach_the_spray_wets_nothing() -> None:
    parts = deposit(greenhouse(fruit((0, 0.9, 0.9))), [0, 0.3, 0.9], [0, 1, 0], CONE, 2.0, reach_m=0.4)
    assert parts.air_ml == pytest.approx(2.0)


def test_the_near_fruit_of_a_pair_shades_the_far_one() -> None:
    plants = greenhouse(fruit((0, 0.6, 0.9), 0.10, number=1), fruit((0, 0.75, 0.9), 0.10, number=2))
    assert set(deposit(plants, [0, 0.45, 0.9], [0, 1, 0], CONE, 3.0).fruit_ml) == {1}


@pytest.mark.parametrize(
    ("axis", "half", "volume", "words"),
    [
        ([0, 0, 0], CONE, 1.0, "axis: expected a finite vector"),
        ([0, 1, 0], 15.0, 1.0, "half_angle_rad: expected above 0 to 1.396, found 15; give radians"),
        ([0, 1, 0], CONE, -1.0, "expected volume_ml >= 0"),
        ([0, 1, 0], CONE, float("nan"), "expected volume_ml >= 0"),
    ],
)
def test_an_impossible_spray_is_refused(axis: list[float], half: float, volume: float, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        deposit(greenhouse(), np.zeros(3), axis, half, volume)

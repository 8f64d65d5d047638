"""The greenhouse is the same for the same seed and obeys the laws of solid bodies."""

from __future__ import annotations

import itertools
from collections import Counter

import numpy as np
import pytest

from drivers.twin.contact import overlaps, touching_distance
from drivers.twin.light import light_at
from drivers.twin.plants import grow
from drivers.twin.renderer import StereoRenderer
from drivers.twin.scene import Scene
from tests.drivers.twin.greenhouses import camera_at, fruit, ideal_optics


def test_the_same_scene_grows_the_same_plants() -> None:
    one, other = grow(Scene(seed=5)), grow(Scene(seed=5))
    assert [f.centre_m.tolist() for f in one.fruits] == [f.centre_m.tolist() for f in other.fruits]
    assert np.array_equal(one.leaves.corner_m, other.leaves.corner_m)


def test_another_seed_grows_other_plants() -> None:
    assert grow(Scene(seed=5)).fruits[0].centre_m.tolist() != grow(Scene(seed=6)).fruits[0].centre_m.tolist()


@pytest.mark.parametrize("seed", range(1, 5))
def test_no_two_fruits_share_space(seed: int) -> None:
    fruits = grow(Scene(seed=seed)).fruits
    for k, one in enumerate(fruits):
        for other in fruits[:k]:
            offset = one.centre_m - other.centre_m
            if np.linalg.norm(offset) < one.semi_equatorial_m + other.semi_equatorial_m:
                assert not overlaps(one.shape(), other.shape(), offset)


def test_clustered_fruits_touch() -> None:
    fruits = grow(Scene(seed=2, cluster_share=1.0)).fruits
    gaps = []
    for one, other in itertools.pairwise(fruits):
        offset = one.centre_m - other.centre_m
        distance = float(np.linalg.norm(offset))
        gaps.append(distance - touching_distance(one.shape(), other.shape(), offset / distance))
    touching = [gap for gap in gaps if 0.0 <= gap < 1e-5]
    assert len(touching) > 0.5 * len(fruits)


def test_spheres_touch_at_the_sum_of_their_radii() -> None:
    one, other = fruit((0, 0, 0), 0.08, 1.0), fruit((0, 0, 0), 0.06, 1.0)
    assert touching_distance(one.shape(), other.shape(), np.array([0.0, 0.6, 0.8])) == pytest.approx(0.07, abs=1e-9)


def test_oblate_fruits_touch_on_their_axes_at_the_sum_of_the_polar_radii() -> None:
    one, other = fruit((0, 0, 0), 0.08, 0.8), fruit((0, 0, 0), 0.06, 0.9)
    reach = touching_distance(one.shape(), other.shape(), np.array([0.0, 0.0, 1.0]))
    assert reach == pytest.approx(one.semi_polar_m + other.semi_polar_m, abs=1e-9)


def test_the_diameter_is_that_of_the_sphere_of_equal_volume() -> None:
    oblate = fruit((0, 0, 0), 0.08, 0.8)
    assert oblate.semi_equatorial_m**2 * oblate.semi_polar_m == pytest.approx(0.04**3)


def test_sizes_heights_and_distances_stay_in_the_crops_range() -> None:
    for seed in range(1, 6):
        for one in grow(Scene(seed=seed)).fruits:
            assert 0.05 <= one.diameter_m <= 0.14
            assert 0.55 <= one.centre_m[2] <= 1.15
            assert 0.38 <= one.centre_m[1] <= 0.83
            assert 0.0 <= one.centre_m[0] <= 4.0


def test_plants_bear_the_asked_number_of_fruits_in_the_asked_colours() -> None:
    fruits = [f for seed in range(8) for f in grow(Scene(seed=seed)).fruits]
    assert len(fruits) / (8 * 9) == pytest.approx(5.0, rel=0.15)
    colours = Counter(f.ripeness for f in fruits)
    assert colours["red"] / len(fruits) == pytest.approx(0.55, abs=0.08)
    assert colours["green"] / len(fruits) == pytest.approx(0.25, abs=0.08)


def test_a_row_at_the_right_stands_at_negative_y() -> None:
    plants = grow(Scene(side="right"))
    assert all(one.centre_m[1] < -0.3 for one in plants.fruits)
    assert plants.wall_y_m < 0.0


def test_no_leaf_pierces_the_middle_of_a_fruit() -> None:
    plants = grow(Scene(seed=3))
    for one in plants.fruits:
        away = plants.leaves.centre_m - one.centre_m
        assert np.min(np.einsum("ni,ij,nj->n", away, one.shape(), away)) > 1.0


def test_most_but_not_all_fruits_show_from_the_best_stop() -> None:
    shares = []
    for seed in (1, 2):
        plants = grow(Scene(seed=seed))
        renderer = StereoRenderer(plants, ideal_optics(), seed)
        best: dict[int, float] = {}
        for x_m in np.arange(0.1, 4.0, 0.4):
            for view in renderer.truth(camera_at(x_m)):
                best[view.id] = max(best.get(view.id, 0.0), view.visible_fraction)
        shares += [best.get(one.id, 0.0) >= 0.6 for one in plants.fruits]
    assert 0.55 <= np.mean(shares) <= 0.85


def test_every_fruit_of_a_bare_row_at_its_stop_is_found_by_some_eye() -> None:
    plants = grow(Scene(seed=4, leaf_density=0.0, row_length_m=0.9))
    renderer = StereoRenderer(plants, ideal_optics(), 1)
    renderer.render(camera_at(0.45), light_at(12.0))
    seen = {view.id for x_m in (0.1, 0.45, 0.8) for view in renderer.truth(camera_at(x_m))}
    assert seen == {one.id for one in plants.fruits}


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"hour": 21.0}, "scene.hour: expected 8 to 20, found 21"),
        ({"hour": float("nan")}, "scene.hour: expected a finite number"),
        ({"red_share": 0.9}, "expected red_share"),
        ({"diameter_min_m": 50.0}, "scene.diameter_min_m"),
        ({"side": "up"}, "scene.side: expected left or right"),
        ({"weather": "snow"}, "scene.weather: expected clear or overcast"),
        ({"row_length_m": 0.0}, "scene.row_length_m"),
    ],
)
def test_an_impossible_scene_is_refused_by_name(wrong: dict[str, object], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        Scene(**wrong)  # type: ignore[arg-type]

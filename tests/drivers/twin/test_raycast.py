"""A ray meets the nearest true surface."""

from __future__ import annotations

import numpy as np
import pytest

from drivers.twin.leaf_pictures import SIZE_PX, leaf_coverage
from drivers.twin.plants import grow
from drivers.twin.raycast import HitKind, first_hit
from drivers.twin.scene import Scene
from drivers.twin.solids import Capsule
from tests.drivers.twin.greenhouses import fruit, greenhouse, leaf

FORWARD = np.array([[0.0, 1.0, 0.0]])


def test_a_ray_at_a_fruits_centre_stops_at_its_near_side() -> None:
    kinds, ids, distances = first_hit(greenhouse(fruit((0, 0.6, 0.9), 0.08, 1.0, number=7)), [0, 0, 0.9], FORWARD)
    assert (kinds[0], ids[0]) == (HitKind.FRUIT, 7)
    assert distances[0] == pytest.approx(0.56)


def test_a_ray_along_the_axis_of_an_oblate_fruit_meets_its_polar_radius() -> None:
    oblate = fruit((0, 0, 0.9), 0.08, 0.8)
    _, _, distances = first_hit(greenhouse(oblate), [0, 0, 2.0], [[0.0, 0.0, -1.0]])
    assert distances[0] == pytest.approx(1.1 - oblate.semi_polar_m)


def test_distance_does_not_depend_on_the_length_of_the_direction() -> None:
    _, _, distances = first_hit(greenhouse(fruit((0, 0.6, 0.9), 0.08, 1.0)), [0, 0, 0.9], 5.0 * FORWARD)
    assert distances[0] == pytest.approx(0.56)


def test_a_ray_past_everything_meets_the_wall() -> None:
    kinds, ids, distances = first_hit(greenhouse(), [0, 0.1, 0.9], FORWARD)
    assert (kinds[0], ids[0]) == (HitKind.WALL, -1)
    assert distances[0] == pytest.approx(1.5)


def test_a_ray_down_meets_the_soil_and_a_ray_up_nothing() -> None:
    kinds, _, distances = first_hit(greenhouse(), [0, 0, 0.9], [[0.0, 0.0, -1.0], [0.0, 0.0, 1.0]])
    assert kinds.tolist() == [HitKind.SOIL, HitKind.AIR]
    assert distances[0] == pytest.approx(0.9)
    assert np.isinf(distances[1])


def test_a_leaf_stops_rays_where_its_picture_covers_and_nowhere_else() -> None:
    size = 0.2
    plants = greenhouse(leaves=leaf((0.0, 0.5, 0.9), size))
    share = (np.arange(SIZE_PX) + 0.5) / SIZE_PX - 0.5
    x, z = np.meshgrid(size * share, 0.9 + size * share)
    origins = np.column_stack([x.ravel(), np.zeros(x.size), z.ravel()])
    kinds, _, _ = first_hit(plants, origins, np.broadcast_to(FORWARD, origins.shape))
    assert np.array_equal((kinds == HitKind.LEAF).reshape(SIZE_PX, SIZE_PX), leaf_coverage(5))


def test_a_stem_is_as_thick_as_its_radius() -> None:
    stem = Capsule(np.array([0.0, 0.5, 0.0]), np.array([0.0, 0.5, 2.0]), 0.01)
    origins = np.array([[0.0099, 0.0, 0.9], [0.0101, 0.0, 0.9], [0.0, 0.0, 0.9]])
    kinds, _, distances = first_hit(greenhouse(stems=(stem,)), origins, np.broadcast_to(FORWARD, origins.shape))
    assert kinds.tolist() == [HitKind.STEM, HitKind.WALL, HitKind.STEM]
    assert distances[2] == pytest.approx(0.49)


def test_the_nearest_of_several_wins() -> None:
    plants = greenhouse(fruit((0, 0.6, 0.9), number=1), fruit((0, 0.8, 0.9), number=2))
    _, ids, _ = first_hit(plants, [0, 0, 0.9], FORWARD)
    assert ids[0] == 1


def test_many_rays_together_meet_what_each_meets_alone() -> None:
    plants = grow(Scene(seed=3, row_length_m=1.8))
    rng = np.random.default_rng(1)
    rays = np.column_stack([rng.uniform(-0.6, 0.6, 150), np.ones(150), rng.uniform(-0.5, 0.5, 150)])
    kinds, ids, distances = first_hit(plants, [0.9, 0.05, 0.9], rays)
    assert {HitKind.FRUIT, HitKind.LEAF, HitKind.WALL} <= set(kinds.tolist())
    for k in range(0, 150, 5):
        kind, id_, distance = first_hit(plants, [0.9, 0.05, 0.9], rays[k : k + 1])
        assert (kind[0], id_[0]) == (kinds[k], ids[k])
        assert distance[0] == pytest.approx(distances[k], abs=1e-9)


def test_a_direction_without_length_is_refused() -> None:
    with pytest.raises(ValueError, match="directions: expected finite vectors longer than 0"):
        first_hit(greenhouse(), [0, 0, 0.9], [[0.0, 0.0, 0.0]])

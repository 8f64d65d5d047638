"""The steps of the fruit detector, each on pictures simple enough to know the answer."""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt
import pytest

from robot.vision.fruit.candidates import find_candidates
from robot.vision.fruit.contour import fit_circles, stack_of, trace
from robot.vision.fruit.network import BLOCK, Network, network_from
from robot.vision.fruit.parameters import FruitParameters
from robot.vision.fruit.planes import linear_light, planes_of, planes_of_light
from robot.vision.fruit.rectify import parallel_pair, rectified
from robot.vision.fruit.skin import skin_features
from robot.vision.fruit.stereo_match import match_discs
from robot.vision.fruit.suppress import keep_best, keep_best_circles
from robot.vision.fruit.weights import load_weights
from tests.robot.vision.greenhouse_views import crooked_rig, demo_rig

Plane = npt.NDArray[np.float32]
LEAF, RED = (40, 120, 50), (40, 40, 190)


def scene_with_discs(
    discs: list[tuple[float, float, float]], size: tuple[int, int] = (640, 480)
) -> npt.NDArray[np.uint8]:
    """Red discs (u, v, r) on leaf green, edges area-sampled by drawing four times as large."""
    large = np.full((size[1] * 4, size[0] * 4, 3), LEAF, dtype=np.uint8)
    for u, v, r in discs:
        centre = (round((u + 0.5) * 64 - 8), round((v + 0.5) * 64 - 8))
        cv2.circle(large, centre, round(r * 64), RED, -1, shift=4)
    return np.asarray(cv2.resize(large, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)


def redness(image: npt.NDArray[np.uint8]) -> Plane:
    """A skin map made by hand: 1 on the red of these pictures, 0 on their green."""
    return np.clip(planes_of(image).red_green / 0.3 + 0.5, 0.0, 1.0).astype(np.float32)


def test_chroma_and_texture_do_not_change_with_the_gain() -> None:
    light = linear_light(scene_with_discs([(200.0, 200.0, 40.0)], (320, 240)))
    bright = planes_of_light(np.asarray(light, dtype=np.float32), 1.0, 1.0)
    half = planes_of_light(np.asarray(0.5 * light, dtype=np.float32), 1.0, 1.0)
    assert np.abs(bright.red_green - half.red_green).max() < 0.01
    assert np.abs(bright.yellow_blue - half.yellow_blue).max() < 0.02
    assert np.abs(skin_features(bright) - skin_features(half)).max() < 0.06


def test_working_pixels_and_stored_pixels_agree_on_where_a_point_is() -> None:
    planes = planes_of(np.zeros((500, 400, 3), dtype=np.uint8))
    assert planes.size == (256, 320)
    points = np.array([[0.0, 0.0], [399.0, 499.0], [123.4, 77.7]])
    assert planes.to_stored(planes.from_stored(points)) == pytest.approx(points)
    assert planes.to_stored([[-0.5, -0.5], [255.5, 319.5]]) == pytest.approx(
        np.array([[-0.5, -0.5], [399.5, 499.5]]), abs=1e-9
    )


@pytest.mark.parametrize("radius_px", [14.0, 25.0, 44.0, 80.0])
def test_a_disc_of_any_size_is_the_strongest_candidate(radius_px: float) -> None:
    image = scene_with_discs([(300.0, 230.0, radius_px)])
    found = find_candidates(planes_of(image), redness(image), limit=10)
    u, v, r = found.circles[0] * 2
    assert np.hypot(u + 0.5 - 300.0, v + 0.5 - 230.0) < 0.15 * radius_px
    assert r == pytest.approx(radius_px, rel=0.2)


def test_two_touching_discs_are_two_candidates() -> None:
    image = scene_with_discs([(250.0, 240.0, 36.0), (322.0, 240.0, 36.0)])
    found = find_candidates(planes_of(image), redness(image), limit=4)
    centres = found.circles[:, :2] * 2
    for u in (250.0, 322.0):
        assert (np.hypot(centres[:, 0] - u, centres[:, 1] - 240.0) < 8.0).any()


def test_the_number_of_candidates_is_bounded() -> None:
    noise = np.random.default_rng(2).integers(0, 256, (480, 640, 3), dtype=np.uint8)
    skin = np.random.default_rng(3).random((240, 320)).astype(np.float32)
    assert len(find_candidates(planes_of(noise), skin, limit=25)) <= 25


def test_a_traced_disc_gives_its_circle_to_a_quarter_of_a_pixel() -> None:
    image = scene_with_discs([(300.3, 230.6, 40.0)])
    planes = planes_of(image)
    contours = trace(stack_of(planes, redness(image)), np.array([[151.5, 113.0, 18.0]]))
    circles, _ = fit_circles(contours)
    u, v = planes.to_stored(circles[0, :2])
    assert np.hypot(u - 300.3, v - 230.6) < 0.25
    assert circles[0, 2] * 2 == pytest.approx(40.0, abs=0.5)


def test_a_leaf_over_a_third_of_a_disc_does_not_shrink_its_circle() -> None:
    image = scene_with_discs([(300.0, 230.0, 40.0)])
    image[:, 316:360] = LEAF
    planes = planes_of(image)
    contours = trace(stack_of(planes, redness(image)), np.array([[148.0, 115.0, 19.0]]))
    circles, _ = fit_circles(contours)
    assert np.hypot(*(planes.to_stored(circles[0, :2]) - [300.0, 230.0])) < 4.0
    assert circles[0, 2] * 2 == pytest.approx(40.0, abs=4.0)


def test_the_parallel_pair_sees_a_point_in_the_same_row_with_both_eyes() -> None:
    rig = crooked_rig()
    pair = parallel_pair(rig, (320, 240))
    point_m = np.array([[0.08, -0.06, 0.55]])
    in_pair = pair.rect_from_left @ point_m[0]
    expected_v = pair.cv + pair.focal_px * in_pair[1] / in_pair[2]
    expected_u = pair.cu + pair.focal_px * in_pair[0] / in_pair[2]
    disparity = pair.focal_px * pair.baseline_m / in_pair[2]
    for pixel, rotation, K, dist, u in (
        (rig.project_left(point_m)[0], pair.rect_from_left, rig.K_left, rig.dist_left, expected_u),
        (rig.project_right(point_m)[0], pair.rect_from_right, rig.K_right, rig.dist_right, expected_u - disparity),
    ):
        v_map, u_map = np.mgrid[:240, :320].astype(np.float64) * 2.0 + 0.5
        spot = np.exp(-((u_map - pixel[0]) ** 2 + (v_map - pixel[1]) ** 2) / (2 * 4.0**2)).astype(np.float32)
        seen = rectified(np.dstack([spot] * 3), pair, rotation, K, dist, np.array([2.0, 2.0]))[..., 0]
        weights = seen / seen.sum()
        rows, columns = np.mgrid[:240, :320]
        assert (weights * columns).sum() == pytest.approx(u, abs=0.05)
        assert (weights * rows).sum() == pytest.approx(expected_v, abs=0.05)


def test_a_disc_is_matched_at_the_disparity_of_its_distance() -> None:
    pair = parallel_pair(demo_rig(), (320, 240))
    distance_m, radius_px = 0.6, 40.0
    shift_px = 457.0 * 0.06 / distance_m
    left = scene_with_discs([(330.0, 230.0, radius_px)])
    right = scene_with_discs([(330.0 - shift_px, 230.0, radius_px)])
    stacks = [stack_of(planes_of(image), redness(image)) for image in (left, right)]
    circle = np.array([[164.75, 114.75, radius_px / 2]])
    match = match_discs(stacks[0], stacks[1], circle, pair, (0.035, 0.17), (0.22, 1.3))
    assert match.disparity_px[0] * 2 == pytest.approx(shift_px, abs=2.5)


def test_nested_circles_are_one_fruit_and_neighbours_are_two() -> None:
    circles = np.array([[100.0, 100.0, 30.0], [104.0, 98.0, 18.0], [162.0, 100.0, 30.0]])
    assert keep_best_circles(circles, np.array([0.9, 0.8, 0.7])).tolist() == [0, 2]


def test_two_depths_of_one_fruit_are_one_fruit() -> None:
    centres = np.array([[0.0, 0.0, 0.5], [0.0, 0.002, 0.58], [0.09, 0.0, 0.5]])
    kept = keep_best(centres, np.full(3, 0.04), np.array([0.6, 0.9, 0.5]), np.ones(3))
    assert kept.tolist() == [1, 2]


def test_of_two_fruit_that_would_stand_in_each_other_only_the_better_stays() -> None:
    centres = np.array([[0.0, 0.0, 0.5], [0.045, 0.0, 0.5]])
    assert keep_best(centres, np.array([0.04, 0.04]), np.array([0.7, 0.8]), np.ones(2)).tolist() == [1]


@pytest.mark.parametrize(("measured_well", "kept"), [(0.9, [0, 1]), (0.1, [0])])
def test_a_circle_that_cuts_another_stays_only_when_it_is_measured_well(measured_well: float, kept: list[int]) -> None:
    centres = np.array([[0.0, 0.0, 0.5], [0.06, 0.0, 0.58]])
    found = keep_best(centres, np.array([0.04, 0.04]), np.array([0.9, 0.5]), np.array([0.9, measured_well]))
    assert found.tolist() == kept


def test_a_network_answers_the_same_in_one_block_or_many() -> None:
    generator = np.random.default_rng(0)
    network = Network(
        np.zeros(3, np.float32),
        np.ones(3, np.float32),
        (generator.normal(size=(3, 4)).astype(np.float32), generator.normal(size=(4, 1)).astype(np.float32)),
        (np.ones(4, np.float32), np.zeros(1, np.float32)),
    )
    rows = generator.normal(size=(2 * BLOCK + 7, 3)).astype(np.float32)
    whole = network.logits(rows)
    by_hand = np.maximum(rows.clip(-6, 6) @ network.weights[0] + 1, 0) @ network.weights[1]
    assert np.abs(whole - by_hand).max() < 1e-4
    again = network_from(network.arrays("x"), "x")
    assert np.array_equal(again.logits(rows), whole)


def test_the_shipped_weights_are_finite_and_small() -> None:
    weights = load_weights()
    for network in (weights.skin, weights.first, weights.final, weights.mono, weights.ripeness):
        for array in network.arrays("n").values():
            assert np.isfinite(array).all()
            assert array.size < 20_000


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"minimum_confidence": 1.5}, "minimum_confidence: expected 0 to 1, found 1.5"),
        ({"diameter_range_m": (0.2, 0.1)}, "diameter_range_m: expected 0 < low < high"),
        ({"distance_range_m": (0.2, 900.0)}, "distance_range_m: expected 0 < low < high"),
        ({"candidates": 0}, "candidates: expected 1 to 400, found 0"),
        ({"refined": 4000}, "refined: expected 1 to 400, found 4000"),
    ],
)
def test_impossible_parameters_are_refused_by_name(change: dict[str, object], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        FruitParameters(**change)  # type: ignore[arg-type]

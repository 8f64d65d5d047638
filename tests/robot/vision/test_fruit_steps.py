"""The steps between two pictures and a measured fruit, each against what is known of the scene."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

from drivers.twin.labelled_scenes import write_scenes
from robot.vision.fruit.look import look
from robot.vision.fruit.measure import NARROW, trace
from robot.vision.fruit.models import Models, load_models
from robot.vision.fruit.pairing import pairs_of
from robot.vision.fruit.parameters import FruitParameters
from robot.vision.fruit.polar import ANGLES, STEPS, TURN_RAD, sample_places, unrolled
from robot.vision.fruit.proposals import REFERENCE_PX, STRIDE, Proposals, overlaps, proposals_of
from robot.vision.fruit.propose import prepare, propose
from robot.vision.fruit.proposer_input import MEAN_CODE, normalised
from robot.vision.fruit.rectify import parallel_pair
from robot.vision.fruit.suppress import keep_best
from robot.vision.stereo_rig import StereoRig
from robot.vision.training.labelled import Scene, scenes
from robot.vision.training.train_judge import truth_of
from tests.robot.vision.spheres import Ball, photograph, small_rig

Array = npt.NDArray[np.float64]


@pytest.fixture(scope="module")
def models() -> Models:
    return load_models()


@pytest.fixture(scope="module")
def twin_scenes(tmp_path_factory: pytest.TempPathFactory) -> list[Scene]:
    folder = tmp_path_factory.mktemp("twin")
    assert write_scenes(folder, count=4, seed=77) > 8
    return list(scenes(folder))


def answer_with(peaks: list[tuple[int, int, float]], size: tuple[int, int] = (60, 80)) -> npt.NDArray[np.float32]:
    """A network's answer with boxes of REFERENCE_PX at (row, column) of a logit, and nothing elsewhere."""
    out = np.zeros((7, *size), dtype=np.float32)
    out[0] = -9.0
    for row, column, logit in peaks:
        out[0, row, column] = logit
    return out


# --- one picture ------------------------------------------------------------------------------------------------


def test_a_common_gain_leaves_the_networks_input_as_it_is() -> None:
    image = np.random.default_rng(3).integers(20, 90, (240, 320, 3), dtype=np.uint8)
    assert np.abs(normalised(image) - normalised(2 * image)).max() < 1e-5
    assert (normalised(image) + 0.5).mean() == pytest.approx(MEAN_CODE, rel=0.01)


@pytest.mark.parametrize("size", [(640, 480), (1280, 720), (500, 400), (333, 217)])
def test_pixels_of_the_networks_input_are_led_back_to_the_stored_ones(size: tuple[int, int]) -> None:
    width, height = size
    image = np.full((height, width, 3), 100, dtype=np.uint8)
    image[height // 2 - 12 : height // 2 + 13, width // 4 - 12 : width // 4 + 13] = 200
    prepared = prepare(image)
    assert prepared.planes.shape[2] % 16 == 0 == prepared.planes.shape[3] % 16
    used = np.rint(np.array([width, height]) / prepared.scale).astype(int)
    light = prepared.planes[0].sum(axis=0)[: used[1], : used[0]]
    light = light - light.min()
    rows, columns = np.indices(light.shape)
    middle = np.array([(columns * light).sum(), (rows * light).sum()]) / light.sum()
    middle = (middle + 0.5) * prepared.scale - 0.5
    assert middle == pytest.approx([width // 4, height // 2], abs=0.5)


def test_a_peak_is_a_box_where_its_cell_is() -> None:
    found = proposals_of(answer_with([(10, 20, 2.0)]), 0.1, 10)
    assert found.boxes[0].tolist() == [20.5 * STRIDE - 0.5, 10.5 * STRIDE - 0.5, REFERENCE_PX, REFERENCE_PX]
    assert found.chance[0] == pytest.approx(1 / (1 + np.exp(-2.0)))


def test_of_two_overlapping_boxes_the_likelier_stays_and_of_two_apart_both() -> None:
    near = proposals_of(answer_with([(10, 20, 2.0), (10, 22, 1.0)]), 0.1, 10)
    apart = proposals_of(answer_with([(10, 20, 2.0), (10, 30, 1.0)]), 0.1, 10)
    assert (len(near), len(apart)) == (1, 2)


def test_overlaps_are_intersections_over_unions() -> None:
    box = np.array([[10.0, 10.0, 4.0, 4.0]])
    others = np.array([[10.0, 10.0, 4.0, 4.0], [12.0, 10.0, 4.0, 4.0], [30.0, 10.0, 4.0, 4.0]])
    assert overlaps(box, others)[0].tolist() == pytest.approx([1.0, 1 / 3, 0.0])


# --- two pictures -----------------------------------------------------------------------------------------------


def boxes_of(balls: list[Ball], rig: StereoRig) -> tuple[Proposals, Proposals]:
    """Exact boxes round the outlines of balls in both views, by projecting their rims."""
    out = []
    for project, eye in ((rig.project_left, np.zeros(3)), (rig.project_right, -rig.R.T @ rig.t_m)):
        boxes = []
        for ball in balls:
            centre, radius = np.array(ball.centre_m), ball.diameter_m / 2
            axis = (centre - eye) / np.linalg.norm(centre - eye)
            across = np.cross(axis, [0.0, 1.0, 0.0])
            across /= np.linalg.norm(across)
            down = np.cross(axis, across)
            distance = float(np.linalg.norm(centre - eye))
            sine = radius / distance
            turn = np.linspace(0, 2 * np.pi, 180, endpoint=False)[:, None]
            rim = eye + axis * distance * (1 - sine**2) + radius * np.sqrt(1 - sine**2) * (
                np.cos(turn) * across + np.sin(turn) * down
            )
            low, high = project(rim).min(axis=0), project(rim).max(axis=0)
            boxes.append([*(low + high) / 2, *(high - low)])
        count = len(balls)
        out.append(Proposals(np.array(boxes), np.full(count, 0.9), np.ones(count), np.ones(count)))
    return out[0], out[1]


@pytest.mark.parametrize("tilted", [False, True])
def test_boxes_of_one_ball_give_its_place_and_size_without_the_depth_bias(tilted: bool) -> None:
    rig = small_rig(tilted)
    ball = Ball((0.04, -0.03, 0.45), 0.10)
    pair = parallel_pair(rig)
    found = pairs_of(*boxes_of([ball], rig), rig, pair, FruitParameters())
    assert len(found) == 1
    centre = found.centre_m[0] @ pair.rect_from_left
    assert np.linalg.norm(centre - ball.centre_m) < 4e-3  # boxes through a bent lens are not quite cones
    assert 2 * found.radius_m[0] == pytest.approx(ball.diameter_m, rel=0.02)


def test_balls_in_other_rows_are_not_paired() -> None:
    rig = small_rig(False)
    balls = [Ball((-0.06, -0.08, 0.5), 0.06), Ball((0.08, 0.08, 0.5), 0.06)]
    found = pairs_of(*boxes_of(balls, rig), rig, parallel_pair(rig), FruitParameters())
    assert sorted(zip(found.left.tolist(), found.right.tolist(), strict=True)) == [(0, 0), (1, 1)]


def test_of_balls_in_one_row_the_true_pairs_come_first() -> None:
    rig = small_rig(False)
    balls = [Ball((-0.08, 0.0, 0.5), 0.05), Ball((0.02, 0.0, 0.5), 0.08), Ball((0.12, 0.0, 0.6), 0.06)]
    found = pairs_of(*boxes_of(balls, rig), rig, parallel_pair(rig), FruitParameters())
    assert set(zip(found.left[:3].tolist(), found.right[:3].tolist(), strict=True)) == {(0, 0), (1, 1), (2, 2)}


@pytest.mark.parametrize("tilted", [False, True])
def test_the_middle_of_the_unrolled_band_is_the_outline_of_the_sphere(tilted: bool) -> None:
    rig = small_rig(tilted)
    ball = Ball((0.03, 0.02, 0.4), 0.09)
    images = photograph([ball], rig)
    pair = parallel_pair(rig)
    centre = pair.rect_from_left @ np.array(ball.centre_m)
    places, band = sample_places(
        centre[None], np.array([ball.diameter_m / 2]), np.zeros((1, 2)), np.array([0.4]), rig, pair
    )
    assert places.shape == (1, 2, ANGLES, STEPS, 2)
    assert band[0] == pytest.approx(0.4 * np.arcsin(0.045 / np.linalg.norm(centre)))
    planes = unrolled(images, places)[0]
    for red, green in ((planes[2], planes[1]), (planes[5], planes[4])):
        inside, outside = slice(0, STEPS // 2 - 1), slice(STEPS // 2 + 1, STEPS)
        assert (red[:, inside] > green[:, inside]).all()
        assert (red[:, outside] < green[:, outside]).all()


def test_samples_beyond_the_picture_are_marked() -> None:
    rig = small_rig(False)
    pair = parallel_pair(rig)
    images = photograph([], rig)
    places, _ = sample_places(
        np.array([[-0.30, 0.0, 0.45]]), np.array([0.05]), np.zeros((1, 2)), np.array([0.4]), rig, pair
    )
    planes = unrolled(images, places)[0]
    beyond = (places[0, :, :, :, 0] < 0) | (places[0, :, :, :, 0] > 319)
    assert beyond.any()
    assert np.array_equal(planes[6:] == 0.0, beyond)


def test_the_traced_outline_leads_a_wrong_guess_to_the_fruit(models: Models, twin_scenes: list[Scene]) -> None:
    before, after = [], []
    for scene in twin_scenes:
        pair = parallel_pair(scene.rig)
        for tomato in (t for t in scene.tomatoes if t.visible_fraction > 0.85):
            true = pair.rect_from_left @ tomato.centre_m
            guess = 1.02 * true + np.array([0.03, -0.03, 0.0]) * tomato.diameter_m
            traced = trace(
                guess[None], np.array([0.52 * tomato.diameter_m]), np.zeros((1, 2)), NARROW,
                (scene.left, scene.right), scene.rig, pair, models.outline,
            )  # fmt: skip
            before.append(np.linalg.norm(guess - true))
            after.append(np.linalg.norm(traced.fit.centre_m[0] - true))
    assert len(after) >= 5
    assert np.median(after) < 0.35 * np.median(before)


def test_guesses_on_fruit_get_the_better_verdict(models: Models, twin_scenes: list[Scene]) -> None:
    right, wrong = [], []
    for scene in twin_scenes:
        pair = parallel_pair(scene.rig)
        for tomato in (t for t in scene.tomatoes if t.visible_fraction > 0.85):
            true = pair.rect_from_left @ tomato.centre_m
            guesses = np.stack([true, 0.7 * true, 1.4 * true])
            radii = 0.5 * tomato.diameter_m * np.array([1.0, 0.7, 1.4])
            traced = trace(
                guesses, radii, np.zeros((3, 2)), 0.42, (scene.left, scene.right), scene.rig, pair, models.outline
            )
            right.append(traced.verdict[0, 0])
            wrong += traced.verdict[1:, 0].tolist()
    assert np.mean(np.array(right) > 0) > 0.9
    assert np.mean(np.array(wrong) < 0) > 0.9


def test_the_evidence_of_the_same_pictures_is_the_same(models: Models, twin_scenes: list[Scene]) -> None:
    scene = twin_scenes[0]
    one, two = (look((scene.left, scene.right), scene.rig, models, FruitParameters()) for _ in range(2))
    assert one is not None
    assert two is not None
    assert np.array_equal(one.evidence, two.evidence)
    assert np.isfinite(one.evidence).all()
    assert truth_of(one, scene)[0][:, 0].any()


def test_both_views_propose_the_fruit_that_show(models: Models, twin_scenes: list[Scene]) -> None:
    found = wanted = 0
    for scene in twin_scenes:
        for side, proposals in zip(
            ("left", "right"), propose(prepare(scene.left, scene.right), models.proposer, 0.1, 48), strict=True
        ):
            for sight in (getattr(t, side) for t in scene.tomatoes if t.visible_fraction > 0.7):
                apart = np.hypot(proposals.boxes[:, 0] - sight.outline.u_px, proposals.boxes[:, 1] - sight.outline.v_px)
                wanted += 1
                found += bool((apart < 0.4 * sight.outline.r_px).any())
    assert wanted >= 12
    assert found >= 0.9 * wanted


# --- one report a fruit -----------------------------------------------------------------------------------------


def test_of_nested_and_overlapping_guesses_the_best_stays() -> None:
    centres = np.array([[0.0, 0.0, 0.5], [0.005, 0.0, 0.6], [0.02, 0.0, 0.5], [0.2, 0.0, 0.5]])
    kept = keep_best(centres, np.full(4, 0.04), np.array([0.9, 0.8, 0.7, 0.6]), np.ones(4))
    assert kept.tolist() == [0, 3]


def test_the_band_goes_once_round() -> None:
    assert TURN_RAD[0] == 0.0
    assert np.diff(TURN_RAD) == pytest.approx(np.full(ANGLES - 1, 2 * np.pi / ANGLES))

"""The training: what it reads, what it asks of the networks, and that they learn it."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt
import pytest

from drivers.twin.labelled_scenes import write_scenes
from robot.vision.fruit import FruitDetector
from robot.vision.fruit.joint_fit import Spheroids
from robot.vision.fruit.measure import WIDE
from robot.vision.fruit.models import model_folder
from robot.vision.fruit.network import sigmoid
from robot.vision.fruit.polar import ANGLES, STEPS, sample_places, unrolled
from robot.vision.training.augment import SIZE, augmented
from robot.vision.training.figures import photo_figures, scene_figures
from robot.vision.training.fitting import fit_network
from robot.vision.training.labelled import Photo, Scene, photos, scenes
from robot.vision.training.traced import places_of, trace_answers
from robot.vision.training.true_outlines import Outline, outline_of_mask, outline_of_points
from robot.vision.training.views import View, views_of_photos, views_of_scenes

Array = npt.NDArray[np.float64]
TURN = np.linspace(0.0, 2 * np.pi, 200, endpoint=False)


@pytest.fixture(scope="module")
def twin_scenes(tmp_path_factory: pytest.TempPathFactory) -> list[Scene]:
    folder = tmp_path_factory.mktemp("twin")
    write_scenes(folder, count=3, seed=21)
    return list(scenes(folder))


# --- labels -----------------------------------------------------------------------------------------------------


def test_the_twins_scenes_are_the_same_for_the_same_seed(tmp_path: Path) -> None:
    for name in ("one", "two"):
        write_scenes(tmp_path / name, count=1, seed=4)
    files = sorted(path.name for path in (tmp_path / "one").iterdir())
    assert [path.split("_")[-1] for path in files] == ["000.json", "000.json", "left.jpg", "right.jpg"]
    for name in files:
        assert (tmp_path / "one" / name).read_bytes() == (tmp_path / "two" / name).read_bytes()


def test_the_truth_of_the_twins_scenes_projects_onto_its_outlines(twin_scenes: list[Scene]) -> None:
    checked = 0
    for scene in twin_scenes:
        for tomato in scene.tomatoes:
            for sight, project in ((tomato.left, scene.rig.project_left), (tomato.right, scene.rig.project_right)):
                u, v = project(tomato.centre_m)[0]
                apart = np.hypot(u - sight.outline.u_px, v - sight.outline.v_px)
                assert apart < 0.12 * sight.outline.r_px
                checked += 1
    assert checked > 20


def test_an_outline_through_exact_points_is_found_again() -> None:
    true = Outline(120.0, 90.0, 31.0, 0.06, -0.03)
    found = outline_of_points(true.points(TURN))
    assert np.abs(found.points(TURN) - true.points(TURN)).max() < 1e-6


@pytest.mark.parametrize("hidden", [False, True])
def test_an_outline_by_box_area_and_mask_is_right_where_a_leaf_hides_it(hidden: bool) -> None:
    true = Outline(120.3, 90.6, 31.0, 0.05, 0.06)
    mask = np.zeros((180, 240), dtype=np.uint8)
    cv2.fillPoly(mask, [np.rint(true.points(TURN) * 256).astype(np.int32)], 1, shift=8)
    if hidden:
        cv2.rectangle(mask, (80, 60), (108, 125), 0, -1)
    radii = true.radii(TURN)
    area = 0.5 * float((radii**2).sum()) * (TURN[1] - TURN[0])
    found = outline_of_mask(mask == 1, true.box(), area)
    assert np.abs(found.radii(TURN) - radii).max() < 0.8


def test_photographs_give_boxes_in_pixel_centres(tmp_path: Path) -> None:
    (tmp_path / "images").mkdir()
    (tmp_path / "annotations").mkdir()
    cv2.imwrite(str(tmp_path / "images" / "one.jpg"), np.full((60, 80, 3), 90, dtype=np.uint8))
    (tmp_path / "annotations" / "one.xml").write_text(
        "<annotation><object><bndbox><xmin>10</xmin><ymin>20</ymin><xmax>50</xmax><ymax>58</ymax></bndbox></object>"
        "</annotation>"
    )
    (tmp_path / "train.txt").write_text("one\n")
    (view,) = views_of_photos(photos(tmp_path, "train"))
    assert view.boxes.tolist() == [[9.5, 19.5, 49.5, 57.5]]
    assert not view.whole
    assert np.isnan(view.ripeness).all()


def test_an_image_that_is_missing_is_named(tmp_path: Path) -> None:
    (tmp_path / "calib_x.json").write_text("{}")
    (tmp_path / "a.json").write_text(json.dumps({"rig": "x", "tomatoes": []}))
    with pytest.raises(FileNotFoundError, match=r"a_left.jpg.*check the data folder"):
        next(scenes(tmp_path))


# --- examples ---------------------------------------------------------------------------------------------------


def disc_view(u: float, v: float, r: float) -> View:
    image = np.full((480, 640, 3), (60, 110, 60), dtype=np.uint8)
    cv2.circle(image, (round(u), round(v)), round(r), (20, 20, 220), -1)
    box = np.array([[u - r, v - r, u + r, v + r]])
    return View(image, box, np.ones(1), np.ones(1), whole=True, mask=None)


def test_an_augmented_picture_keeps_its_fruit_in_its_box() -> None:
    generator = np.random.default_rng(8)
    inside = []
    for _ in range(40):
        example = augmented(disc_view(320, 240, 60), generator)
        assert example.planes.shape == (3, SIZE[1], SIZE[0])
        left, top, right, bottom = example.boxes[0]
        u, v = round((left + right) / 2), round((top + bottom) / 2)
        if 0 <= u < SIZE[0] and 0 <= v < SIZE[1]:
            blue, green, red = example.planes[:, v, u]
            inside.append(red > max(blue, green))
    assert len(inside) > 25
    assert np.mean(inside) > 0.9


def test_the_edge_a_guess_is_asked_for_is_where_the_picture_changes(twin_scenes: list[Scene]) -> None:
    misses = []
    for place in places_of(twin_scenes):
        for known in (fruit for fruit in place.fruits if fruit.visible > 0.95):
            centre, radius = 1.01 * known.centre_m, 1.05 * known.radius_m
            at, band = sample_places(
                centre[None], np.array([radius]), np.zeros((1, 2)), np.array([WIDE]), place.rig, place.pair
            )
            trace = trace_answers(place, unrolled(place.images, at)[0], at[0], centre, radius)
            assert trace.fruit == 1.0
            for eye, outline in enumerate(known.outlines):
                rows = np.flatnonzero(np.isfinite(trace.offset[eye]))
                step = trace.offset[eye, rows] + (STEPS - 1) / 2
                low = np.floor(step).astype(int)
                ends = at[0, eye, rows, low], at[0, eye, rows, np.minimum(low + 1, STEPS - 1)]
                point = ends[0] + (step - low)[:, None] * (ends[1] - ends[0])
                across = point - [outline.u_px, outline.v_px]
                radii = outline.radii(np.arctan2(across[:, 1], across[:, 0]))
                misses += (np.hypot(across[:, 0], across[:, 1]) - radii).tolist()
            assert band[0] > 0
    assert len(misses) > 4 * ANGLES
    assert np.abs(misses).max() < 0.1


def test_a_guess_where_there_is_no_fruit_is_told_to_be_none(twin_scenes: list[Scene]) -> None:
    place = places_of(twin_scenes)[0]
    centre = np.array([0.0, 0.0, 3.0])
    at, _ = sample_places(centre[None], np.array([0.05]), np.zeros((1, 2)), np.array([WIDE]), place.rig, place.pair)
    trace = trace_answers(place, unrolled(place.images, at)[0], at[0], centre, 0.05)
    assert trace.fruit == 0.0
    assert np.isnan(trace.offset).all()


# --- the verifier -----------------------------------------------------------------------------------------------


def test_a_network_learns_what_a_line_cannot_separate_and_the_same_seed_gives_the_same_weights() -> None:
    generator = np.random.default_rng(1)
    points = generator.uniform(-1, 1, (2000, 2))
    inside = (np.hypot(*points.T) < 0.6).astype(np.float64)
    one, two = (fit_network(points, inside, hidden=(12,), steps=1500, batch=256, rate=0.02) for _ in range(2))
    answer = sigmoid(one.logits(points))[:, 0] > 0.5
    assert np.mean(answer == (inside > 0.5)) > 0.95
    assert np.array_equal(one.weights[0], two.weights[0])


def test_the_equal_volume_diameter_of_a_flattened_fit() -> None:
    fit = Spheroids(
        np.zeros((1, 3)), np.array([0.04]), np.array([[0.06, 0.0]]), np.eye(4)[None],
        np.zeros((1, 2, 4)), np.ones((1, 2, 4)), np.ones(1),
    )  # fmt: skip
    wide, high = 0.04 * 1.06, 0.04 * 0.94
    assert fit.volume_radius_m[0] == pytest.approx((wide**2 * high) ** (1 / 3), rel=2e-3)


# --- figures ----------------------------------------------------------------------------------------------------


def test_the_figures_count_what_is_found_and_what_is_not(twin_scenes: list[Scene]) -> None:
    figures = scene_figures(FruitDetector(), twin_scenes)
    shown = sum(t.visible_fraction >= 0.6 for scene in twin_scenes for t in scene.tomatoes)
    assert figures.fruits == shown
    assert figures.recognition["all"] > 0.8
    assert 0.8 < figures.precision <= 1.0
    assert 0.0 < figures.median_mm < figures.p95_mm < 60.0


def test_a_photograph_without_fruit_has_no_boxes_and_no_hits() -> None:
    photo = Photo("wall", np.full((100, 120, 3), 200, dtype=np.uint8), np.zeros((0, 4)))
    figures = photo_figures(FruitDetector(), [photo])
    assert (figures.boxes, figures.recall, figures.f1) == (0, 0.0, 0.0)


# --- the networks as shipped ------------------------------------------------------------------------------------


def test_the_model_card_is_of_the_shipped_networks() -> None:
    card = Path(__file__).parents[3] / "docs" / "model-card.md"
    for name in ("proposer.onnx", "outline.onnx", "judge.npz"):
        digest = hashlib.sha256(model_folder().joinpath(name).read_bytes()).hexdigest()
        assert f"`{name}` {digest}" in card.read_text(encoding="utf-8")


@pytest.mark.long
def test_training_goes_its_whole_way(tmp_path: Path) -> None:
    """A few steps on a few scenes: networks that OpenCV runs, a verifier, and their card."""
    pytest.importorskip("torch", reason="torch is not installed: pip install '.[train]'")
    pytest.importorskip("onnx", reason="onnx is not installed: pip install '.[train]'")
    from robot.vision.training.__main__ import main

    write_scenes(tmp_path / "a", count=4, seed=31)
    write_scenes(tmp_path / "b", count=4, seed=32)
    (tmp_path / "p" / "images").mkdir(parents=True)
    (tmp_path / "p" / "annotations").mkdir()
    for split, scene in zip(("train", "val"), scenes(tmp_path / "a"), strict=False):
        cv2.imwrite(str(tmp_path / "p" / "images" / f"{split}.jpg"), scene.left)
        boxes = "".join(
            "<object><bndbox>"
            + "".join(
                f"<{k}>{x:.0f}</{k}>"
                for k, x in zip(("xmin", "ymin", "xmax", "ymax"), tomato.left.outline.box(), strict=True)
            )
            + "</bndbox></object>"
            for tomato in scene.tomatoes
        )
        (tmp_path / "p" / "annotations" / f"{split}.xml").write_text(f"<annotation>{boxes}</annotation>")
        (tmp_path / "p" / f"{split}.txt").write_text(f"{split}\n")
    arguments = {
        "rendered": tmp_path / "a", "twin": tmp_path / "b", "photos": tmp_path / "p", "held-out": tmp_path / "b",
        "out": tmp_path / "models", "card": tmp_path / "card.md", "steps": 150,
    }  # fmt: skip
    assert main([part for name, value in arguments.items() for part in (f"--{name}", str(value))]) == 0
    assert {path.name for path in (tmp_path / "models").iterdir()} == {
        "proposer.onnx", "outline.onnx", "judge.npz", "digests.json",
    }  # fmt: skip
    assert "150 steps" in (tmp_path / "card.md").read_text(encoding="utf-8")


def test_both_views_of_a_scene_are_training_pictures(twin_scenes: list[Scene]) -> None:
    views = list(views_of_scenes(twin_scenes))
    assert len(views) == 2 * len(twin_scenes)
    assert all(len(view.boxes) == len(view.ripeness) == len(view.visible) for view in views)

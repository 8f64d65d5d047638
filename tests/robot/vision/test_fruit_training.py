"""The training programs: what they read, what they call a fruit, and that fitting fits."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from robot.vision.fruit.joint_fit import Spheroids
from robot.vision.fruit.network import sigmoid
from robot.vision.fruit.rectify import parallel_pair
from robot.vision.training.fitting import fit_network
from robot.vision.training.labelled import Scene, Tomato, photos, scenes
from robot.vision.training.verifier import Table, add_photo_pixels, add_scene_pixels, targets_of
from robot.vision.values import Ripeness
from tests.robot.vision.greenhouse_views import demo_rig


def scene_with(*tomatoes: Tomato) -> Scene:
    image = np.full((480, 640, 3), (40, 120, 50), dtype=np.uint8)
    mask = np.zeros((480, 640), dtype=np.uint8)
    for tomato in tomatoes:
        u, v = (round(float(x)) for x in demo_rig().project_left(tomato.centre_m)[0])
        cv2.circle(image, (u, v), 40, (30, 30, 190), -1)
        cv2.circle(mask, (u, v), 40, tomato.number, -1)
    return Scene("made", image, image, mask, mask, demo_rig(), tomatoes)


def one_fit(centre_m: tuple[float, float, float], diameter_m: float) -> Spheroids:
    return Spheroids(
        centre_m=np.array([centre_m]),
        radius_m=np.array([0.5 * diameter_m]),
        harmonic=np.zeros((1, 2)),
        covariance=np.eye(4)[None],
        residual_px=np.zeros((1, 2, 64)),
        weights=np.ones((1, 2, 64)),
        sigma_px=np.ones(1),
    )


def test_a_network_learns_what_a_line_cannot_separate_and_the_same_seed_gives_the_same_weights() -> None:
    generator = np.random.default_rng(1)
    points = generator.uniform(-1, 1, (2000, 2))
    inside = (np.hypot(*points.T) < 0.6).astype(np.float64)
    one, two = (fit_network(points, inside, hidden=(12,), steps=1500, batch=256, rate=0.02) for _ in range(2))
    answer = sigmoid(one.logits(points))[:, 0] > 0.5
    assert np.mean(answer == (inside > 0.5)) > 0.95
    assert np.array_equal(one.weights[0], two.weights[0])


@pytest.mark.parametrize(
    ("centre_m", "diameter_m", "expected"),
    [
        ((0.0, 0.0, 0.605), 0.08, [1.0, 1.0]),
        ((0.0, 0.0, 0.63), 0.08, [1.0, 0.0]),
        ((0.0, 0.0, 0.605), 0.10, [1.0, 0.0]),
        ((0.0, 0.0, 0.66), 0.08, [0.0, 0.0]),
    ],
)
def test_a_hypothesis_is_judged_by_its_distance_and_size(
    centre_m: tuple[float, float, float], diameter_m: float, expected: list[float]
) -> None:
    scene = scene_with(Tomato(1, np.array([0.0, 0.0, 0.6]), 0.08, Ripeness.RED, 1.0))
    targets, nearest = targets_of(one_fit(centre_m, diameter_m), parallel_pair(scene.rig, (320, 240)), scene)
    assert targets[0].tolist() == expected
    assert nearest[0] == 0


def test_nothing_is_a_fruit_in_an_empty_scene() -> None:
    scene = scene_with()
    targets, _ = targets_of(one_fit((0.0, 0.0, 0.6), 0.08), parallel_pair(scene.rig, (320, 240)), scene)
    assert targets.tolist() == [[0.0, 0.0]]


def test_pixels_are_labelled_by_the_mask_of_each_view() -> None:
    table = Table()
    add_scene_pixels(
        table, scene_with(Tomato(3, np.array([0.0, 0.0, 0.6]), 0.08, Ripeness.GREEN, 1.0)), np.random.default_rng(0)
    )
    features, targets = np.concatenate(table.features), np.concatenate(table.targets)[:, 0]
    red_green = features[:, 0]
    assert red_green[targets > 0.5].min() > 0.2 > 0.0 > red_green[targets < 0.5].mean()
    assert (np.concatenate(table.weights)[targets > 0.9] == 5.0).all(), "green fruit weighs most"


def test_pixels_near_the_edge_of_a_box_are_left_out(tmp_path: Path) -> None:
    _photo_folder(tmp_path)
    photo = next(photos(tmp_path, "train"))
    table = Table()
    add_photo_pixels(table, photo, np.random.default_rng(0))
    red = np.concatenate(table.features)[:, 0]
    targets = np.concatenate(table.targets)[:, 0]
    assert red[targets > 0.5].min() > 0.2
    assert red[targets < 0.5].max() < 0.1


def test_scenes_are_read_with_the_calibration_beside_or_above_them(tmp_path: Path) -> None:
    rig = demo_rig()
    names = ("K_left", "K_right", "dist_left", "dist_right", "R", "t_m")
    calibration = {name: getattr(rig, name).tolist() for name in names} | {"image_size": [640, 480]}
    (tmp_path / "calib_demo.json").write_text(json.dumps(calibration))
    folder = tmp_path / "set"
    folder.mkdir()
    tomato = {"id": 1, "centre_m": [0, 0, 0.6], "diameter_m": 0.08, "ripeness": "red", "visible_fraction_min": 0.9}
    (folder / "a.json").write_text(json.dumps({"rig": "demo", "tomatoes": [tomato]}))
    for side in ("left", "right"):
        cv2.imwrite(str(folder / f"a_{side}.jpg"), np.zeros((480, 640, 3), np.uint8))
        cv2.imwrite(str(folder / f"a_mask_{side}.png"), np.zeros((480, 640), np.uint8))
    (scene,) = scenes(folder)
    assert scene.rig.baseline_m == pytest.approx(0.06)
    assert scene.tomatoes[0].ripeness is Ripeness.RED
    (folder / "a_mask_left.png").unlink()
    with pytest.raises(FileNotFoundError, match=r"a_mask_left\.png"):
        list(scenes(folder))


def _photo_folder(folder: Path) -> None:
    for name in ("images", "annotations"):
        (folder / name).mkdir()
    image = np.full((300, 300, 3), (40, 120, 50), dtype=np.uint8)
    cv2.circle(image, (150, 150), 50, (30, 30, 190), -1)
    cv2.imwrite(str(folder / "images" / "one.jpg"), image)
    box = "<bndbox><xmin>100</xmin><ymin>100</ymin><xmax>200</xmax><ymax>200</ymax></bndbox>"
    (folder / "annotations" / "one.xml").write_text(f"<annotation><object>{box}</object></annotation>")
    (folder / "train.txt").write_text("one\n")

"""Pictures, rigs and networks that the fruit detector cannot work with are refused with the reason."""

from __future__ import annotations

import hashlib
import itertools
import json
import shutil
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt
import pytest

from robot.vision.fruit import FruitDetector, FruitParameters, ModelError
from robot.vision.fruit.judge import load_judge
from robot.vision.fruit.models import load_models, model_folder
from robot.vision.fruit.proposals import proposals_of
from tests.robot.vision.greenhouse_views import View, demo_rig, views

Image = npt.NDArray[np.uint8]


@pytest.fixture(scope="module")
def detector() -> FruitDetector:
    return FruitDetector()


@pytest.fixture(scope="module")
def view() -> View:
    return views(demo_rig(), seed=31, hour=12.0, at_x_m=(0.4,))[0]


@pytest.fixture
def models(tmp_path: Path) -> Path:
    """A copy of the shipped networks."""
    folder = tmp_path / "models"
    shutil.copytree(str(model_folder()), folder)
    return folder


def everything(models: Path) -> FruitDetector:
    return FruitDetector(models=load_models(models), judge=load_judge(models))


@pytest.mark.parametrize("side", ["left", "right"])
def test_an_image_that_is_not_of_the_rigs_size_is_refused_with_both_sizes(
    detector: FruitDetector, view: View, side: str
) -> None:
    images = {"left": view.left, "right": view.right}
    images[side] = np.ascontiguousarray(images[side][:400])
    with pytest.raises(ValueError, match=rf"the {side} image of 640 x 480.*found 640 x 400"):
        detector.detect(images["left"], images["right"], view.rig)


def test_one_grey_plane_is_refused(detector: FruitDetector) -> None:
    with pytest.raises(ValueError, match=r"uint8 BGR, found \(480, 640\)"):
        detector.detect_mono(np.zeros((480, 640), dtype=np.uint8))


def test_a_grey_camera_is_refused_since_ripeness_is_a_colour(detector: FruitDetector, view: View) -> None:
    grey = cv2.cvtColor(cv2.cvtColor(view.left, cv2.COLOR_BGR2GRAY), cv2.COLOR_GRAY2BGR)
    with pytest.raises(ValueError, match="all three channels equal; set the camera to colour"):
        detector.detect(np.asarray(grey, dtype=np.uint8), view.right, view.rig)


def test_an_image_of_floats_is_refused(detector: FruitDetector) -> None:
    with pytest.raises(ValueError, match=r"found .* of float64; convert it first"):
        detector.detect_mono(np.full((480, 640, 3), np.nan))  # type: ignore[arg-type]


def test_a_stamp_of_an_image_is_refused(detector: FruitDetector) -> None:
    with pytest.raises(ValueError, match="at least 32 x 32 pixels, found 20 x 16"):
        detector.detect_mono(np.full((16, 20, 3), 90, dtype=np.uint8))


@pytest.mark.parametrize("side", ["left", "right"])
def test_one_black_eye_is_refused_and_named(detector: FruitDetector, view: View, side: str) -> None:
    images = {"left": view.left, "right": view.right}
    images[side] = np.random.default_rng(1).integers(0, 3, view.left.shape, dtype=np.uint8)
    with pytest.raises(ValueError, match=f"the {side} image to show something, found it black"):
        detector.detect(images["left"], images["right"], view.rig)


@pytest.mark.parametrize("level", [20, 128, 255])
def test_a_covered_lens_shows_no_fruit(detector: FruitDetector, level: int) -> None:
    image = np.full((480, 640, 3), level, dtype=np.uint8)
    assert detector.detect(image, image, demo_rig()) == ()
    assert detector.detect_mono(image) == ()


@pytest.mark.parametrize("field", ["K_left", "dist_right", "R", "t_m"])
def test_a_rig_with_a_number_that_is_none_is_refused(detector: FruitDetector, view: View, field: str) -> None:
    broken = np.array(getattr(view.rig, field), dtype=np.float64)
    broken.flat[0] = np.nan
    with pytest.raises(ValueError, match=f"finite numbers in the rig's {field}.*calibrate again"):
        detector.detect(view.left, view.right, replace(view.rig, **{field: broken}))


def test_a_rig_with_its_cameras_exchanged_is_refused(detector: FruitDetector, view: View) -> None:
    exchanged = replace(view.rig, t_m=np.array([0.06, 0.0, 0.0]))
    with pytest.raises(ValueError, match="right camera to the right of the left"):
        detector.detect(view.left, view.right, exchanged)


def test_noise_gives_a_bounded_finite_answer(detector: FruitDetector) -> None:
    noise = np.random.default_rng(0).integers(0, 256, (2, 480, 640, 3), dtype=np.uint8)
    fruits = detector.detect(noise[0], noise[1], demo_rig())
    assert len(fruits) <= FruitParameters().candidates
    assert all(np.isfinite(fruit.centre_m).all() for fruit in fruits)


def test_a_thousand_red_dots_are_bounded_by_the_parameters(detector: FruitDetector) -> None:
    image = np.full((480, 640, 3), (40, 90, 40), dtype=np.uint8)
    for u, v in itertools.product(range(8, 640, 20), range(8, 480, 16)):
        cv2.circle(image, (u, v), 6, (30, 30, 190), -1)
    assert len(detector.detect(image, image, demo_rig())) <= FruitParameters().candidates
    assert len(detector.detect_mono(image)) <= FruitParameters().proposals


def test_ten_thousand_peaks_become_no_more_proposals_than_allowed() -> None:
    answer = np.full((7, 400, 400), -9.0, dtype=np.float32)
    answer[0, ::4, ::4] = np.random.default_rng(0).uniform(0.0, 4.0, (100, 100))
    answer[1:] = 0.0
    found = proposals_of(answer, 0.1, 48)
    assert len(found) == 48
    assert (np.diff(found.chance) <= 0).all()


def test_a_network_that_says_nan_finds_nothing() -> None:
    assert len(proposals_of(np.full((7, 60, 80), np.nan, dtype=np.float32), 0.1, 48)) == 0


@pytest.mark.parametrize("name", ["proposer.onnx", "outline.onnx", "judge.npz", "digests.json"])
def test_a_network_that_is_missing_is_named_with_the_remedy(models: Path, name: str) -> None:
    (models / name).unlink()
    with pytest.raises(ModelError, match=rf"{name.split('.')[0]}.*make train"):
        everything(models)


@pytest.mark.parametrize("name", ["proposer.onnx", "outline.onnx", "judge.npz"])
def test_a_network_with_a_changed_byte_is_refused(models: Path, name: str) -> None:
    data = bytearray((models / name).read_bytes())
    data[len(data) // 2] ^= 1
    (models / name).write_bytes(bytes(data))
    with pytest.raises(ModelError, match=rf"{name}: expected the digest [0-9a-f]{{12}}, found [0-9a-f]{{12}}"):
        everything(models)


def test_a_file_that_is_no_network_is_refused_though_its_digest_is_right(models: Path) -> None:
    (models / "proposer.onnx").write_bytes(b"no network")
    digests = json.loads((models / "digests.json").read_text())
    digests["proposer.onnx"] = hashlib.sha256(b"no network").hexdigest()
    (models / "digests.json").write_text(json.dumps(digests))
    with pytest.raises(ModelError, match=r"proposer.onnx: not a network that this OpenCV reads"):
        load_models(models)


@pytest.mark.parametrize(
    ("name", "value"),
    [("minimum_confidence", 1.5), ("least_chance", 0.0), ("diameter_range_m", (0.1, 0.05)), ("candidates", 0)],
)
def test_an_impossible_parameter_is_refused_by_name(name: str, value: object) -> None:
    with pytest.raises(ValueError, match=name):
        FruitParameters(**{name: value})  # type: ignore[arg-type]

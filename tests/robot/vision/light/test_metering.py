"""The meter on pictures of the twin: what it looks at, and what it must not mind."""

from __future__ import annotations

import itertools
import os
from pathlib import Path

import cv2
import numpy as np
import pytest

from drivers.twin.light import light_at
from drivers.twin.optics import StereoOptics
from drivers.twin.plants import grow
from drivers.twin.renderer import StereoRenderer
from drivers.twin.scene import Scene
from robot.vision.light import LightGoals, LightState, Reading, judge, meter
from tests.robot.vision.greenhouse_views import demo_rig

SHARED = Path(os.environ.get("SPRAYER_SHARED", Path(__file__).parents[5] / "shared"))
GREENHOUSE = SHARED / "data" / "greenhouse" / "dev"
GOALS = LightGoals()
POSE = np.array([[1, 0, 0, 0.7], [0, 0, 1, 0.05], [0, -1, 0, 0.88], [0, 0, 0, 1.0]])

Image = np.ndarray


@pytest.fixture(scope="module")
def renderer() -> StereoRenderer:
    rig = demo_rig()
    optics = StereoOptics(rig.image_size, rig.K_left, rig.K_right, rig.dist_left, rig.dist_right, rig.R, rig.t_m)
    return StereoRenderer(grow(Scene(seed=3, row_length_m=2.0)), optics, 3)


def taken(renderer: StereoRenderer, hour: float, exposure_s: float, gain: float, *, lamp: bool = False):
    return renderer.render(POSE, light_at(hour, lamp_on=lamp), exposure_s, gain)


def read(renderer: StereoRenderer, hour: float, exposure_s: float, gain: float, *, lamp: bool = False) -> Reading:
    return meter(*taken(renderer, hour, exposure_s, gain, lamp=lamp), exposure_s, gain)


def linear(view: Image) -> Image:
    codes = view / 255.0
    return np.where(codes <= 0.04045, codes / 12.92, ((codes + 0.055) / 1.055) ** 2.4)


def encoded(light: Image) -> Image:
    light = np.clip(light, 0.0, 1.0)
    return np.round(255.0 * np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)).astype(
        np.uint8
    )


@pytest.mark.parametrize(("hour", "lamp"), [(8.0, False), (12.0, False), (16.0, False), (19.0, False), (20.0, True)])
def test_the_illumination_is_the_same_at_every_exposure_and_gain(renderer, hour, lamp):
    readings = [
        read(renderer, hour, exposure_s, gain, lamp=lamp)
        for exposure_s, gain in ((0.002, 1.0), (0.004, 1.0), (0.002, 4.0), (0.008, 1.0), (0.01, 1.5))
    ]
    found = [reading.illumination_1_s for reading in readings]
    assert max(found) / min(found) < 1.25
    assert [reading.level for reading in readings] == pytest.approx(
        [reading.illumination_1_s * p for reading, p in zip(readings, (0.002, 0.004, 0.008, 0.008, 0.015), strict=True)]
    )


def test_the_day_goes_by(renderer):
    """Noon is brighter than evening, evening than dusk, and at dusk the lamp helps."""
    noon, evening, dusk = (read(renderer, hour, 0.01, 2.0).illumination_1_s for hour in (12.0, 18.0, 20.0))
    lamp = read(renderer, 20.0, 0.01, 2.0, lamp=True).illumination_1_s
    assert noon > 1.5 * evening > 10.0 * dusk
    assert lamp > 10.0 * dusk


def test_a_white_sky_above_the_plants_is_not_metered(renderer):
    left, right = taken(renderer, 12.0, 0.004, 1.0)
    plain = meter(left, right, 0.004, 1.0)
    under_sky = []
    for view in (left, right):
        view = view.copy()
        pale = cv2.cvtColor(view, cv2.COLOR_BGR2HSV)[..., 1] < 60
        view[pale & (np.arange(len(view)) < 300)[:, None]] = 255
        under_sky.append(view)
    below = meter(*under_sky, 0.004, 1.0)
    assert np.mean([view.mean() for view in under_sky]) > 1.3 * np.mean([left.mean(), right.mean()])
    assert below.level == pytest.approx(plain.level, rel=0.2)
    assert below.burnt_share < 0.02


def test_a_paler_or_darker_wall_hardly_matters(renderer):
    """Only what is pale changes, by a factor of four down and two up."""
    left, right = taken(renderer, 12.0, 0.004, 1.0)
    plain = meter(left, right, 0.004, 1.0).level
    for factor in (0.25, 0.5, 2.0):
        changed = []
        for view in (left, right):
            pale = cv2.GaussianBlur(
                (cv2.cvtColor(view, cv2.COLOR_BGR2HSV)[..., 1] < 60).astype(np.float64), (0, 0), 0.8
            )[..., None]
            changed.append(encoded(linear(view) * (1.0 + pale * (factor - 1.0))))
        assert meter(*changed, 0.004, 1.0).level == pytest.approx(plain, rel=0.3)


@pytest.mark.parametrize("hour", [8.0, 12.0, 19.0])
def test_a_drifting_white_balance_does_not_change_the_judgement(renderer, hour):
    """Each channel between 0.8 and 1.25 of its light: the level moves no more than the channels do, by little more."""
    pair = taken(renderer, hour, 0.006, 1.0)
    plain = meter(*pair, 0.006, 1.0)
    for factors in itertools.product((0.8, 1.0, 1.25), repeat=3):
        drifted = meter(*(encoded(linear(view) * factors) for view in pair), 0.006, 1.0)
        assert 0.72 < drifted.level / plain.level < 1.4
        assert drifted.plants_seen
        assert judge(drifted, GOALS) in (judge(plain, GOALS), LightState.GOOD, LightState.DIM)
        assert drifted.plant_share == pytest.approx(plain.plant_share, abs=0.12)


@pytest.mark.skipif(
    not GREENHOUSE.exists(), reason="no greenhouse set: put it beside the project or set SPRAYER_SHARED"
)
def test_white_balance_on_pictures_that_were_not_rendered_here():
    ratios = []
    for number in (0, 9, 18, 27, 39, 48, 54, 60, 66):
        pair = [cv2.imread(str(GREENHOUSE / f"dev_{number:03d}_{side}.jpg")) for side in ("left", "right")]
        plain = meter(pair[0], pair[1], 0.004, 1.0)
        assert plain.plants_seen
        for factors in ((0.8, 1.0, 1.25), (1.25, 1.0, 0.8), (1.0, 0.8, 1.25), (0.8, 1.25, 1.0)):
            drifted = meter(*(encoded(linear(view) * factors) for view in pair), 0.004, 1.0)
            ratios.append(drifted.level / plain.level)
    assert min(ratios) > 0.78
    assert max(ratios) < 1.3


def test_without_plants_the_whole_picture_is_metered():
    wall = np.full((120, 160, 3), (140, 138, 136), np.uint8)
    reading = meter(wall, wall, 0.004, 1.0)
    assert (reading.plants_seen, reading.glare, reading.backlight) == (False, False, False)
    assert reading.plant_share == 0.0
    assert reading.level == pytest.approx(float(linear(np.array(140.0))), rel=1e-3)


def test_burnt_plants_are_counted(renderer):
    reading = read(renderer, 12.0, 0.05, 1.0)
    assert reading.highlight >= 0.96
    assert reading.burnt_share > 0.2
    assert read(renderer, 12.0, 0.004, 1.0).burnt_share < 0.01
    white = np.full((120, 160, 3), 255, np.uint8)
    assert judge(meter(white, white, 0.004, 1.0), GOALS) is LightState.BRIGHT


def test_backlight_and_glare_are_told(renderer):
    left, right = taken(renderer, 12.0, 0.004, 1.0)
    plain = meter(left, right, 0.004, 1.0)
    against, veiled = [], []
    for view in (left, right):
        pale = (cv2.cvtColor(view, cv2.COLOR_BGR2HSV)[..., 1] < 60)[..., None]
        against.append(encoded(linear(view) * np.where(pale, 2.0, 0.2)))
        veiled.append(encoded(0.8 * linear(view) + 0.16))
    assert (plain.backlight, plain.glare) == (False, False)
    assert meter(*against, 0.004, 1.0).backlight
    assert meter(*veiled, 0.004, 1.0).glare


def test_a_finer_picture_reads_the_same(renderer):
    left, right = taken(renderer, 12.0, 0.004, 1.0)
    fine = [cv2.resize(view, (1280, 960), interpolation=cv2.INTER_LINEAR) for view in (left, right)]
    assert meter(*fine, 0.004, 1.0).level == pytest.approx(meter(left, right, 0.004, 1.0).level, rel=0.05)


@pytest.mark.parametrize(
    ("left", "exposure_s", "gain", "words"),
    [
        (np.zeros((48, 64), np.uint8), 0.004, 1.0, r"left: expected \(height, width, 3\) BGR .* found \(48, 64\)"),
        (np.zeros((48, 64, 3), np.float32), 0.004, 1.0, "of float32"),
        (np.zeros((0, 64, 3), np.uint8), 0.004, 1.0, "found"),
        (np.zeros((48, 64, 3), np.uint8), 0.0, 1.0, "expected seconds and gain above 0, found 0 s and 1"),
        (np.zeros((48, 64, 3), np.uint8), float("nan"), 1.0, "found nan s"),
        (np.zeros((48, 64, 3), np.uint8), 0.004, 0.0, "and 0"),
    ],
)
def test_what_is_no_picture_is_refused(left, exposure_s, gain, words):
    with pytest.raises(ValueError, match=words):
        meter(left, np.zeros((48, 64, 3), np.uint8), exposure_s, gain)


def test_black_pictures_read_as_no_light():
    black = np.zeros((48, 64, 3), np.uint8)
    reading = meter(black, black, 0.02, 8.0)
    assert (reading.level, reading.signal, reading.illumination_1_s) == (0.0, 0.0, 0.0)
    assert judge(reading, GOALS) is LightState.DARK

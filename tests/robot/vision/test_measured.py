"""A detector's word that it measured a fruit, held against the truth."""

from __future__ import annotations

import numpy as np
import pytest

from robot.vision.fruit.look import look
from robot.vision.fruit.models import load_models
from robot.vision.fruit.parameters import FruitParameters
from robot.vision.fruit.uncertainty import spread_of
from robot.vision.make import DetectorName, make_detector
from tests.robot.vision.greenhouse_views import demo_rig, views


@pytest.fixture(scope="module")
def looks() -> list[tuple[bool, float, float, float]]:
    """(measured, sigma as a share of the diameter, error of the diameter as a share, true visible share) of fruits."""
    name: DetectorName = "fruit"
    detector, found = make_detector(name), []
    for seed in (3, 4):
        for view in views(demo_rig(), seed=seed, hour=12.0, at_x_m=(0.4, 1.0, 1.6)):
            for fruit in detector.detect(view.left, view.right, view.rig):
                true = min(view.fruits, key=lambda true, at=fruit.centre_m: np.linalg.norm(true.centre_m - at))
                if np.linalg.norm(true.centre_m - fruit.centre_m) < 0.5 * true.diameter_m + 0.02:
                    error = abs(fruit.diameter_m / true.diameter_m - 1.0)
                    found.append(
                        (fruit.measured, fruit.diameter_sigma_m / fruit.diameter_m, error, true.visible_fraction)
                    )
    return found


def test_fruit_in_full_view_is_measured(looks: list[tuple[bool, float, float, float]]) -> None:
    clear = [measured for measured, _, _, visible in looks if visible > 0.9]
    assert len(clear) >= 15
    assert sum(clear) >= 0.9 * len(clear)


def test_what_is_called_measured_is_measured(looks: list[tuple[bool, float, float, float]]) -> None:
    errors = [error for measured, _, error, _ in looks if measured]
    assert np.median(errors) < 0.02
    assert np.percentile(errors, 90) < 0.08


def test_an_estimate_says_how_wide_it_is() -> None:
    view = views(demo_rig(), seed=3, hour=12.0, at_x_m=(1.0,))[0]
    looked = look((view.left, view.right), view.rig, load_models(), FruitParameters())
    assert looked is not None
    count = len(looked.evidence)
    measured, estimated = (spread_of(looked.second, np.full(count, well), looked.pair) for well in (0.98, 0.1))
    assert np.median(estimated.diameter_m / measured.diameter_m) > 3.0
    volumes = [np.sqrt(np.linalg.det(spread.centre_m2)) for spread in (measured, estimated)]
    assert np.median(volumes[1] / volumes[0]) > 3.0

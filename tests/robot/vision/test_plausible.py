"""What a detector gives is believed only when it can be."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from robot.vision.plausible import MOST_FRUITS, implausible
from robot.vision.values import Circle, Fruit, Ripeness

SIZE = (640, 480)
CIRCLE = Circle(320.0, 240.0, 30.0, Ripeness.RED, 0.9)
GOOD = Fruit(
    centre_m=np.array([0.1, -0.2, 0.6]), covariance_m2=np.eye(3) * 1e-6, diameter_m=0.07, diameter_sigma_m=0.002,
    ripeness=Ripeness.RED, ripeness_score=0.9, confidence=0.9, visible_fraction=1.0, measured=True, left=CIRCLE,
    right=CIRCLE,
)  # fmt: skip
NAN, INF = float("nan"), float("inf")


def test_good_fruits_and_none_at_all_are_believed():
    assert implausible((), SIZE) == ""
    assert implausible((GOOD,) * MOST_FRUITS, SIZE) == ""


@pytest.mark.parametrize("u_px", [-29.0, 669.0])
def test_a_fruit_that_is_cut_by_the_images_edge_is_believed(u_px):
    assert implausible((replace(GOOD, left=replace(CIRCLE, u_px=u_px)),), SIZE) == ""


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"centre_m": np.array([NAN, 0.0, 0.6])}, "the centre"),
        ({"centre_m": np.array([0.0, 0.0, -0.6])}, "the centre"),
        ({"centre_m": np.array([0.0, 0.0, 21.0])}, "the centre"),
        ({"centre_m": np.array([0.0, 0.6])}, "the centre"),
        ({"covariance_m2": np.full((3, 3), INF)}, "covariance"),
        ({"covariance_m2": -np.eye(3)}, "covariance"),
        ({"covariance_m2": np.eye(2)}, "covariance"),
        ({"diameter_m": 0.0}, "a diameter of 0.0"),
        ({"diameter_m": INF}, "a diameter of inf"),
        ({"diameter_m": NAN}, "a diameter of nan"),
        ({"diameter_sigma_m": -0.1}, "a diameter's error"),
        ({"diameter_sigma_m": INF}, "a diameter's error"),
        ({"confidence": 1.1}, "shares"),
        ({"visible_fraction": NAN}, "shares"),
        ({"ripeness_score": -0.1}, "shares"),
        ({"left": replace(CIRCLE, r_px=5000.0)}, "the outline"),
        ({"left": replace(CIRCLE, r_px=0.0)}, "the outline"),
        ({"right": replace(CIRCLE, u_px=NAN)}, "the outline"),
        ({"right": replace(CIRCLE, v_px=600.0)}, "the outline"),
    ],
)
def test_one_fruit_that_cannot_be_spoils_the_frame(change, words):
    why = implausible((GOOD, replace(GOOD, **change)), SIZE)
    assert why.startswith("fruit 2 of 2 with ")
    assert words in why


def test_more_fruits_than_a_picture_can_hold_are_not_looked_at_one_by_one():
    assert implausible((GOOD,) * 10_000, SIZE) == f"10000 fruits (at most {MOST_FRUITS} are believed)"

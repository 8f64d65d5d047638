"""Fruit drawn onto an image."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from robot.annotate import draw_circles, draw_fruits
from robot.vision.values import Circle, Fruit, Ripeness

LEFT = Circle(80.0, 60.0, 20.0, Ripeness.RED, 0.9)
FRUIT = Fruit(
    np.array([0.1, 0.0, 0.5]), np.eye(3) * 1e-6, 0.08, 0.002, Ripeness.RED, 0.9, 0.9, 1.0, True, left=LEFT, right=LEFT
)


def test_the_outline_is_drawn_in_the_colour_of_ripeness_and_the_original_stays() -> None:
    image = np.full((120, 160, 3), 128, dtype=np.uint8)
    drawn = draw_fruits(image, [FRUIT])
    assert (image == 128).all()
    blue, green, red = drawn[60, 100]
    assert red > 200
    assert max(blue, green) < 100
    assert (drawn[60, 80] == 128).all()


def test_a_target_number_changes_the_label() -> None:
    image = np.full((120, 160, 3), 128, dtype=np.uint8)
    assert (draw_fruits(image, [FRUIT]) != draw_fruits(image, [FRUIT], [7])).any()


def test_the_size_of_a_fruit_that_was_not_measured_is_marked() -> None:
    image = np.full((120, 160, 3), 128, dtype=np.uint8)
    assert (draw_fruits(image, [FRUIT]) != draw_fruits(image, [replace(FRUIT, measured=False)])).any()


def test_a_number_without_its_fruit_is_refused() -> None:
    with pytest.raises(ValueError, match="found 2 for 1 fruit"):
        draw_fruits(np.zeros((120, 160, 3), dtype=np.uint8), [FRUIT], [7, 8])


@pytest.mark.parametrize("centre", [(0.0, 0.0), (159.0, 119.0), (-30.0, 300.0)])
def test_circles_at_or_beyond_the_border_are_drawn_as_far_as_they_reach(centre: tuple[float, float]) -> None:
    image = np.zeros((120, 160, 3), dtype=np.uint8)
    drawn = draw_circles(image, [Circle(*centre, 30.0, Ripeness.GREEN, 0.5)])
    assert drawn.shape == image.shape
    assert drawn.any()

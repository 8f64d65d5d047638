"""Sections 3.3.1 to 3.3.3 of the paper up to the closed regions."""

from __future__ import annotations

import math

import cv2
import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robot.vision.paper import PaperParameters
from robot.vision.paper.excess_green import excess_green
from robot.vision.paper.outline import laplacian, outlines
from robot.vision.paper.regions import circularity, round_regions

Image = npt.NDArray[np.uint8]
Level = st.integers(0, 255)

LEAF_BGR, RED_BGR = (40, 140, 50), (30, 30, 190)


def pixel(blue: int, green: int, red: int) -> Image:
    return np.array([[[blue, green, red]]], dtype=np.uint8)


@given(blue=Level, green=Level, red=Level, weight=st.sampled_from([2.0, 2.5]))
def test_excess_green_is_equation_1_for_every_colour(blue: int, green: int, red: int, weight: float) -> None:
    found = int(excess_green(pixel(blue, green, red), weight)[0, 0])
    if 2 * green < red + blue:
        assert found == 0
    else:
        assert found == pytest.approx(min(255.0, weight * green - red - blue), abs=0.5)


def test_green_weight_of_the_text_makes_grey_exactly_zero() -> None:
    assert excess_green(pixel(90, 90, 90), 2.0)[0, 0] == 0
    assert excess_green(pixel(90, 90, 90), 2.5)[0, 0] == 45


@pytest.mark.parametrize(("neighbours", "at_spot", "beside", "diagonal"), [(4, -400, 100, 0), (8, -800, 100, 100)])
def test_laplacian_of_a_spot_is_its_kernel(neighbours: int, at_spot: int, beside: int, diagonal: int) -> None:
    spot = np.zeros((5, 5), dtype=np.uint8)
    spot[2, 2] = 100
    found = laplacian(spot, neighbours)
    assert (found[2, 2], found[2, 1], found[1, 1]) == (at_spot, beside, diagonal)


def test_laplacian_of_a_ramp_is_zero() -> None:
    ramp = np.tile(np.arange(0, 200, 10, dtype=np.uint8), (9, 1))
    assert not laplacian(ramp, 8)[1:-1, 1:-1].any()


def test_circularity_is_one_for_a_circle_and_pi_over_four_for_a_square() -> None:
    assert circularity(math.pi * 25.0, math.tau * 5.0) == pytest.approx(1.0)
    assert circularity(1.0, 4.0) == pytest.approx(math.pi / 4.0)
    assert circularity(0.0, 0.0) == 0.0


def disc_on_leaves(radius: int = 40) -> Image:
    image = np.full((240, 320, 3), LEAF_BGR, dtype=np.uint8)
    cv2.circle(image, (150, 120), radius, RED_BGR, cv2.FILLED, cv2.LINE_AA)
    return image


@pytest.mark.parametrize("reading", ["binary", "laplacian"])
def test_a_red_disc_among_leaves_is_one_round_region(reading: str) -> None:
    parameters = PaperParameters(reading=reading)  # type: ignore[arg-type]
    (region,) = round_regions(outlines(disc_on_leaves(), parameters), parameters)
    assert region.area_px == pytest.approx(math.pi * 40.0**2, rel=0.06)
    assert region.circularity > 0.85
    assert np.hypot(*(region.contour - [150, 120]).T) == pytest.approx(40.0, abs=2.0)


def test_a_disc_cut_by_the_border_is_no_closed_region() -> None:
    parameters = PaperParameters()
    assert round_regions(outlines(disc_on_leaves()[:, 130:], parameters), parameters) == []


def test_a_long_bar_is_not_round_enough() -> None:
    image = np.full((240, 320, 3), LEAF_BGR, dtype=np.uint8)
    image[100:120, 40:280] = RED_BGR
    parameters = PaperParameters()
    assert round_regions(outlines(image, parameters), parameters) == []


def test_regions_smaller_or_larger_than_admitted_are_left_out() -> None:
    image = disc_on_leaves()
    edges = outlines(image, PaperParameters())
    assert round_regions(edges, PaperParameters(min_area=0.1)) == []
    assert round_regions(edges, PaperParameters(max_area=0.05)) == []


@pytest.mark.parametrize(
    "wrong",
    [
        {"green_weight": 5.0},
        {"neighbours": 6},
        {"reading": "edges"},
        {"min_area": 0.3, "max_area": 0.2},
        {"min_circularity": 0.0},
        {"min_distance_m": 2.0},
        {"retries": -1},
        {"median_px": 4},
        {"row_tolerance_px": 0.0},
        {"horizontal_skip": 0.0},
    ],
)
def test_impossible_parameters_are_refused(wrong: dict[str, object]) -> None:
    with pytest.raises(ValueError):
        PaperParameters(**wrong)  # type: ignore[arg-type]

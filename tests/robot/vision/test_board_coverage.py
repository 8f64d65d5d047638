"""What has been shown of a board, and advice that leads to a complete set."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

from robot.geometry import Transform, rotation_from_rpy
from robot.vision.board_corners import Board
from robot.vision.board_coverage import GRID, Distance, Tilt, coverage, distance_bounds_m
from robot.vision.camera_calibration import BoardView
from tests.robot.vision.greenhouse_views import demo_rig

Array = npt.NDArray[np.float64]

BOARD = Board(7, 5, 0.03)
RIG = demo_rig()
FOCAL_PX = float(RIG.K_left[0, 0])
TURNS = {  # about the camera's x and y
    Tilt.FACING: (0.0, 0.0),
    Tilt.LEFT_NEARER: (0.0, -0.5),
    Tilt.RIGHT_NEARER: (0.0, 0.5),
    Tilt.UPPER_NEARER: (0.5, 0.0),
    Tilt.LOWER_NEARER: (-0.5, 0.0),
}
DISTANCES_M = {Distance.NEAR: 0.37, Distance.MIDDLE: 0.5, Distance.FAR: 0.75}


def shown(tilt: Tilt, distance_m: float, u: float = 320.0, v: float = 240.0, dx_m: float = 0.0) -> BoardView:
    """The board's middle at pixel (u, v) of the left image."""
    turn = rotation_from_rpy(*TURNS[tilt], 0.05)
    middle_m = np.array([(u - 319.5) / FOCAL_PX, (v - 239.5) / FOCAL_PX, 1.0]) * distance_m + [dx_m, 0.0, 0.0]
    points_m = Transform(turn, middle_m - turn @ BOARD.points_m().mean(axis=0)).apply(BOARD.points_m())
    return BoardView("", RIG.project_left(points_m), RIG.project_right(points_m))


def nearer_edge(view: BoardView) -> Tilt:
    """By perspective alone: the longer of two opposite sides is the nearer one."""
    grid = view.left_px.reshape(5, 7, 2)
    ends = {Tilt.LEFT_NEARER: grid[[0, -1], 0], Tilt.RIGHT_NEARER: grid[[0, -1], -1],
            Tilt.UPPER_NEARER: grid[0, [0, -1]] * 4 / 6, Tilt.LOWER_NEARER: grid[-1, [0, -1]] * 4 / 6}  # fmt: skip
    lengths = {tilt: float(np.linalg.norm(end[1] - end[0])) for tilt, end in ends.items()}
    across = lengths[Tilt.LEFT_NEARER] - lengths[Tilt.RIGHT_NEARER]
    down = lengths[Tilt.UPPER_NEARER] - lengths[Tilt.LOWER_NEARER]
    if abs(across) > abs(down):
        return Tilt.LEFT_NEARER if across > 0 else Tilt.RIGHT_NEARER
    return Tilt.UPPER_NEARER if down > 0 else Tilt.LOWER_NEARER


@pytest.mark.parametrize("tilt", [tilt for tilt in Tilt if tilt is not Tilt.FACING])
def test_the_edge_that_is_nearer_is_named(tilt: Tilt) -> None:
    view = shown(tilt, 0.5)
    assert nearer_edge(view) is tilt
    assert coverage([view], BOARD, RIG.image_size, FOCAL_PX).tilts == {each: int(each is tilt) for each in Tilt}


def test_a_board_held_square_faces_the_camera() -> None:
    assert coverage([shown(Tilt.FACING, 0.5)], BOARD, RIG.image_size, FOCAL_PX).tilts[Tilt.FACING] == 1


@pytest.mark.parametrize("distance", list(Distance))
def test_distances_are_told_even_with_a_guessed_focal_length(distance: Distance) -> None:
    for focal_px in (FOCAL_PX, None):
        seen = coverage([shown(Tilt.FACING, DISTANCES_M[distance])], BOARD, RIG.image_size, focal_px)
        assert seen.distances == {each: int(each is distance) for each in Distance}


def test_the_bounds_of_the_distances_join_and_fill_the_range() -> None:
    bounds = [distance_bounds_m(distance, (0.3, 0.9)) for distance in Distance]
    assert bounds[0][0] == pytest.approx(0.3)
    assert bounds[-1][1] == pytest.approx(0.9)
    assert [low for low, _ in bounds[1:]] == pytest.approx([high for _, high in bounds[:-1]])


def test_cells_are_those_in_which_corners_lie() -> None:
    view = shown(Tilt.FACING, 0.75, 100.0, 120.0, 0.06)
    seen = coverage([view], BOARD, RIG.image_size, FOCAL_PX)
    for cells, corners in ((seen.left_cells, view.left_px), (seen.right_cells, view.right_px)):
        row, column = (corners[17] * GRID / np.array([640, 480])).astype(int)[::-1]
        assert cells[row, column]
        assert not cells[GRID - 1].any()
        assert not cells[:, GRID - 1].any()
    assert seen.missing_regions[0] != "upper left"


def test_no_view_yet_asks_for_the_first() -> None:
    seen = coverage([], BOARD, RIG.image_size)
    assert seen.cell_share == 0.0
    assert seen.advice == (
        "hold the board in the upper left of the image, as far out as both lenses see it whole, facing the camera, "
        "near (0.30 to 0.43 m)"
    )


def as_far_out_as_both_see_it(tilt: Tilt, distance_m: float, u: float, v: float) -> BoardView:
    for inward in np.linspace(0.0, 1.0, 21):
        view = shown(tilt, distance_m, u + inward * (345.0 - u), v + inward * (240.0 - v))
        both = np.concatenate([view.left_px, view.right_px])
        if (both >= 3.0).all() and (both <= [636.0, 476.0]).all():
            return view
    raise AssertionError(f"{tilt} at {distance_m} m fits nowhere")


def test_whoever_follows_the_advice_is_done_in_at_most_twenty_five_views() -> None:
    places = {"upper": 0.0, "middle": 240.0, "lower": 480.0}, {"left": 0.0, "middle": 345.0, "right": 640.0}
    taken: list[BoardView] = []
    heard = set()
    while (advice := coverage(taken, BOARD, RIG.image_size, FOCAL_PX).advice) is not None:
        heard.add(advice)
        tilt = next((tilt for tilt in Tilt if tilt in advice), Tilt.FACING)
        distance = next((far for far in Distance if f"{far} (" in advice), Distance.FAR)
        down = next((word for word in ("upper", "lower") if word in advice.split(" of the image")[0]), "middle")
        across = next((word for word in ("left", "right") if word in advice.split(" of the image")[0]), "middle")
        taken.append(as_far_out_as_both_see_it(tilt, DISTANCES_M[distance], places[1][across], places[0][down]))
        assert len(taken) <= 25, f"still: {advice}"
    assert len(heard) >= 8
    covered = coverage(taken, BOARD, RIG.image_size, FOCAL_PX)
    assert covered.complete
    assert min(covered.tilts.values()) >= 2
    assert min(covered.distances.values()) >= 2

"""A board that looks the same from both ends is told apart by the arm that holds it."""

from __future__ import annotations

import numpy as np
import pytest

from robot.geometry import Transform
from robot.vision.board_corners import Board
from robot.vision.board_ends import turned_views
from tests.robot.arm_with_board import BOARD, show
from tests.robot.vision.greenhouse_views import crooked_rig
from tests.robot.vision.test_hand_eye import ARM_FROM_CAMERA

HALF_TURN = Transform(np.diag([-1.0, -1.0, 1.0]), np.array([6 * BOARD.square_m, 4 * BOARD.square_m, 0.0]))


@pytest.mark.parametrize("first_turned", [False, True])
def test_views_that_begin_at_the_other_end_than_the_first_are_named(first_turned: bool) -> None:
    shown = show(12, crooked_rig(), ARM_FROM_CAMERA, seed=7)
    turned = [first_turned, *(index % 3 == 0 for index in range(1, 12))]
    poses = [s.camera_from_board for s in shown]
    seen = [pose @ HALF_TURN if end else pose for pose, end in zip(poses, turned, strict=True)]
    found = turned_views([s.arm_from_tool for s in shown], seen, BOARD)
    assert found == [end != first_turned for end in turned]


def test_a_board_with_two_different_ends_is_never_turned() -> None:
    shown = show(6, crooked_rig(), ARM_FROM_CAMERA, seed=7)
    poses = [s.camera_from_board for s in shown]
    assert turned_views([s.arm_from_tool for s in shown], poses[::-1], Board(8, 5, 0.03)) == [False] * 6

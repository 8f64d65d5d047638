"""At which end a board begins that looks the same after half a turn, when an arm holds it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from robot.geometry import Transform
from robot.vision.board_corners import Board

Array = npt.NDArray[np.float64]

_MOST_RAD = np.radians(30.0)  # a difference that large says as much as any larger one


def turned_views(
    arm_from_tool: Sequence[Transform], camera_from_board: Sequence[Transform], board: Board
) -> list[bool]:
    """Which poses see the board from its other end than the first pose does.

    Between two poses the arm and the camera must see the same angle of turn; half a turn of the board changes that of
    the camera. The tool must not have turned by about a right angle about the board's normal from all other poses.
    """
    if (board.columns + board.rows) % 2:
        return [False] * len(arm_from_tool)
    half_turn = np.diag([-1.0, -1.0, 1.0])
    ends = [[pose.rotation, pose.rotation @ half_turn] for pose in camera_from_board]
    turned = [False]
    for index in range(1, len(ends)):
        disagreement = [0.0, 0.0]
        for before in range(index):
            by_arm = _angle_rad(arm_from_tool[index].rotation @ arm_from_tool[before].rotation.T)
            for end in (0, 1):
                by_camera = _angle_rad(ends[index][end] @ ends[before][turned[before]].T)
                disagreement[end] += min(abs(by_camera - by_arm), _MOST_RAD)
        turned.append(bool(disagreement[1] < disagreement[0]))
    return turned


def _angle_rad(rotation: Array) -> float:
    return float(np.arccos(np.clip((np.trace(rotation) - 1.0) / 2.0, -1.0, 1.0)))

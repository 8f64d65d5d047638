"""An arm that shows a board to the camera beside it: true mounts, joint angles, and what both lenses see."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from robot.aiming import ArmModel, link_frames, nearest_solution, parse_urdf
from robot.geometry import Transform, rotation_from_rpy, transform_from_xyz_rpy
from robot.package_files import packaged
from robot.vision.board_corners import Board
from robot.vision.camera_calibration import BoardView
from robot.vision.stereo_rig import StereoRig

Array = npt.NDArray[np.float64]

BOARD = Board(7, 5, 0.03)
READY_RAD = np.array([0.5, -0.7, 0.3, 0.0, 0.4, 0.0])
BASE_FROM_ARM = transform_from_xyz_rpy((0.15, 0.10, 0.45), (0.0, 0.0, np.pi / 2))
# columns: the board's x to the tool's right, its y down, its z along the spray axis; 3 cm before the nozzle's tip
TOOL_FROM_BOARD = Transform(
    np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]) @ rotation_from_rpy(0.02, -0.03, 0.05),
    np.array([0.03, 0.09, 0.06]),
)


@dataclass(frozen=True)
class Shown:
    """One pose: true joint angles and the board as both lenses see it, to the last digit."""

    name: str
    joints_rad: Array
    arm_from_tool: Transform
    camera_from_board: Transform
    view: BoardView


def arm() -> ArmModel:
    return parse_urdf((packaged("configs") / "arms/viperx300_nozzle.urdf").read_text(encoding="utf-8"))


def tool_pose(model: ArmModel, joints_rad: Array) -> Transform:
    frames = link_frames(model, joints_rad)
    return Transform(frames.rotation[-1], frames.origin_m[-1])


def show(
    count: int, rig: StereoRig, arm_from_camera: Transform, seed: int, tilt_rad: float = 0.5, roll_rad: float = 0.6
) -> list[Shown]:
    """Poses in which the whole board is in both images; the tool is tilted by up to ``tilt_rad`` to any side."""
    model, rng = arm(), np.random.default_rng(seed)
    inside = np.array(rig.image_size) - 1.0
    found: list[Shown] = []
    for _ in range(5000):
        if len(found) == count:
            return found
        middle = arm_from_camera.apply([rng.uniform(-0.15, 0.15), rng.uniform(-0.12, 0.12), rng.uniform(0.33, 0.6)])
        up, side = rng.uniform(-tilt_rad, tilt_rad, 2)
        axis = arm_from_camera.rotate([np.sin(side), np.sin(up), 1.0])
        begin = READY_RAD.copy()
        begin[5] = rng.uniform(-roll_rad, roll_rad)
        joints_rad = nearest_solution(model, middle - 0.05 * axis, axis, begin)
        if joints_rad is None:
            continue
        tool = tool_pose(model, joints_rad)
        camera_from_board = arm_from_camera.inverse() @ tool @ TOOL_FROM_BOARD
        points_m = camera_from_board.apply(BOARD.points_m())
        left, right = rig.project_left(points_m), rig.project_right(points_m)
        both = np.concatenate([left, right])
        facing = camera_from_board.rotation[2, 2] > 0.7
        if facing and (points_m[:, 2] > 0.2).all() and (both >= 0.0).all() and (both <= inside).all():
            name = f"pose{len(found) + 1:02d}"
            found.append(Shown(name, joints_rad, tool, camera_from_board, BoardView(name, left, right)))
    raise AssertionError(f"only {len(found)} of {count} poses show the board")

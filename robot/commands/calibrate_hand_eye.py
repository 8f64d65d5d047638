"""``sprayer calibrate hand-eye``: where the camera sits, from pictures of a board that the arm holds."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated

import numpy as np
import numpy.typing as npt
import typer
from rich.console import Console
from rich.table import Table

from robot.aiming import ArmModel, link_frames, nozzle_jacobian, within_limits
from robot.commands.board_images import BoardOption, BoardSearch, SquareOption, find_boards, parse_board
from robot.commands.run import ConfigOption
from robot.config import Config, load_config
from robot.errors import ConfigError, FileError
from robot.geometry import Transform, body_from_optical, rpy_from_rotation, transform_from_xyz_rpy
from robot.image_folder import ImagePair, find_pairs
from robot.joint_angles_file import read_joint_angles
from robot.package_files import config_file
from robot.runtime.settings import load_arm, load_camera
from robot.toml_values import difference, read_toml_text, with_numbers, write_toml_text
from robot.vision.board_corners import Board
from robot.vision.board_ends import turned_views
from robot.vision.board_pose import BoardPose, estimate_board_pose
from robot.vision.camera_calibration import BoardView
from robot.vision.hand_eye import ArmPose, HandEye, PoseResidual, rms, solve_hand_eye
from robot.vision.stereo_rig import StereoRig

Array = npt.NDArray[np.float64]

_BAD_REPROJECTION_PX = 1.0  # of the board through the calibration: it no longer holds, or the board is another one
_FAR_M = 0.10


def calibrate_hand_eye(
    images: Annotated[Path, typer.Argument(metavar="DIR", help="Pairs <id>_left.* and <id>_right.*")],
    joints: Annotated[
        Path, typer.Option("--joints", metavar="FILE", help='A line each: {"id": "...", "joints_rad": [...]}')
    ],
    config: ConfigOption,
    board: BoardOption,
    square_m: SquareOption,
    joint_sigma_deg: Annotated[
        float, typer.Option("--joint-sigma-deg", min=0.001, max=5.0, help="How well the arm knows its joint angles.")
    ] = 0.05,
    write: Annotated[
        Path | None, typer.Option("--write", metavar="FILE", help="Put the values into this configuration file.")
    ] = None,
) -> None:
    """Find where the camera is mounted, from pairs in which the arm holds a board, each with its joint angles."""
    settings, path = load_config(config), config_file(config)
    chessboard = parse_board(board, square_m)
    model, _ = load_arm(settings, path)
    rig = load_camera(settings, path)
    angles_rad = read_joint_angles(joints, len(model.joints))
    pairs = _matching(find_pairs(images), angles_rad, images, joints)
    _check_limits(angles_rad, model, joints)
    if write is not None:
        _with_mount(write, list(settings.rig.camera_xyz_m), list(settings.rig.camera_rpy_rad))  # can it be written?
    search = find_boards([(pair.scene_id, pair.left, pair.right) for pair in pairs], chessboard)
    if search.image_size != rig.image_size:
        (width, height), (wide, high) = rig.image_size, search.image_size
        raise ConfigError(
            f"{images}: the pairs have {wide}x{high} pixels, camera.calibration is for {width}x{height}; "
            "take them at the size that is used"
        )
    for skipped in search.skipped:
        _say(f"skipped {skipped.path}: {skipped.why}")
    try:
        found = solve_hand_eye(_poses(search, chessboard, rig, model, angles_rad, math.radians(joint_sigma_deg)))
    except ValueError as error:
        raise FileError(f"{images}: no hand-eye calibration: {error}") from error
    xyz_m, rpy_rad = _mount(settings, found.arm_from_camera)
    Console().print(_table(found))
    for line in _summary(settings, found, xyz_m, rpy_rad):
        _say(line)
    if write is not None:
        before, after = read_toml_text(write), _with_mount(write, xyz_m, rpy_rad)
        _say(difference(before, after, str(write)) or f"{write}: holds these values already")
        write_toml_text(write, after)
        _say(f"written: {write}")


def _matching(
    pairs: Sequence[ImagePair], angles_rad: Mapping[str, tuple[float, ...]], images: Path, joints: Path
) -> list[ImagePair]:
    names = {pair.scene_id for pair in pairs}
    without_angles = sorted(names - set(angles_rad))
    without_pair = sorted(set(angles_rad) - names)
    if without_angles:
        raise FileError(f"{joints}: has no angles for the pair '{without_angles[0]}' of {images}; "
                        f"add its line or take the pair away ({len(without_angles)} such)")  # fmt: skip
    if without_pair:
        raise FileError(f"{images}: has no pair '{without_pair[0]}', which {joints.name} names; "
                        f"add the images or take its line away ({len(without_pair)} such)")  # fmt: skip
    return list(pairs)


def _check_limits(angles_rad: Mapping[str, tuple[float, ...]], model: ArmModel, joints: Path) -> None:
    for name, angles in angles_rad.items():
        if not within_limits(model, np.array(angles), tolerance_rad=math.radians(3.0)):
            raise FileError(
                f"{joints}: '{name}' is outside the limits of {model.name}: {list(angles)} rad; "
                "are the joints in the order of the URDF?"
            )


def _poses(
    search: BoardSearch, board: Board, rig: StereoRig, model: ArmModel, angles_rad: Mapping[str, tuple[float, ...]],
    sigma_rad: float,
) -> list[ArmPose]:  # fmt: skip
    boards = [estimate_board_pose(view, board, rig) for view in search.views]
    _check_reprojection(boards)
    angles = [np.array(angles_rad[view.name]) for view in search.views]
    tools = [_tool(model, joints_rad) for joints_rad in angles]
    for index, turned in enumerate(turned_views(tools, [seen.camera_from_board for seen in boards], board)):
        if turned:
            view = search.views[index]
            other_end = BoardView(view.name, view.left_px[::-1].copy(), view.right_px[::-1].copy())
            boards[index] = estimate_board_pose(other_end, board, rig)
    covariances = [_tool_covariance(model, *pose, sigma_rad) for pose in zip(angles, tools, strict=True)]
    return [
        ArmPose(seen.name, tool, seen.camera_from_board, covariance, seen.covariance)
        for seen, tool, covariance in zip(boards, tools, covariances, strict=True)
    ]


def _tool(model: ArmModel, joints_rad: Array) -> Transform:
    """``arm_from_tool``: the nozzle's frame in the arm's base."""
    frames = link_frames(model, joints_rad)
    return Transform(frames.rotation[-1], frames.origin_m[-1])


def _check_reprojection(boards: Sequence[BoardPose]) -> None:
    if boards and (median_px := float(np.median([seen.rms_px for seen in boards]))) > _BAD_REPROJECTION_PX:
        raise ValueError(
            f"corners lie {median_px:.1f} px from where the camera's calibration puts them; check --board and "
            "--square-m, and calibrate the camera first"
        )


def _tool_covariance(model: ArmModel, angles: Array, arm_from_tool: Transform, sigma_rad: float) -> Array:
    """(6, 6) of turn and shift in the tool's frame when each joint is off by ``sigma_rad``."""
    jacobian = nozzle_jacobian(model, angles)
    turning = arm_from_tool.rotation.T @ jacobian[3:]
    shifting = arm_from_tool.rotation.T @ jacobian[:3]
    in_tool = np.concatenate([turning, shifting])
    return np.asarray(in_tool @ in_tool.T * sigma_rad**2)


def _mount(config: Config, arm_from_camera: Transform) -> tuple[list[float], list[float]]:
    """``rig.camera_xyz_m`` and ``rig.camera_rpy_rad``; which side the rig faces turns camera and arm alike."""
    arm = transform_from_xyz_rpy(config.rig.arm_xyz_m, config.rig.arm_rpy_rad)
    body = arm @ arm_from_camera @ body_from_optical().inverse()
    return [round(float(v), 5) for v in body.translation_m], [round(v, 6) for v in rpy_from_rotation(body.rotation)]


def _with_mount(path: Path, xyz_m: list[float], rpy_rad: list[float]) -> str:
    values = {"camera_xyz_m": xyz_m, "camera_rpy_rad": rpy_rad}
    return with_numbers(read_toml_text(path), "rig", values, str(path))


def _table(found: HandEye) -> Table:
    table = Table(title="The board by the camera against the board by the arm")
    for column in ("pose", "shift, mm", "turn, deg", "held out: shift, mm", "turn, deg"):
        table.add_column(column, justify="left" if column == "pose" else "right")
    for used, out in zip(found.residuals, found.held_out, strict=True):
        table.add_row(used.name, *_figures(used), *_figures(out), style="red" if used.outlier else None)
    return table


def _figures(residual: PoseResidual) -> tuple[str, str]:
    return f"{1e3 * residual.shift_m:.2f}", f"{math.degrees(residual.turn_rad):.3f}"


def _summary(config: Config, found: HandEye, xyz_m: list[float], rpy_rad: list[float]) -> list[str]:
    (shift_m, turn_rad), (out_m, out_rad) = rms(found.residuals), rms(found.held_out)
    sigma_mm = ", ".join(f"{1e3 * value:.2f}" for value in found.sigma_m)
    sigma_deg = ", ".join(f"{math.degrees(value):.3f}" for value in found.sigma_rad)
    lines = [
        f"{len(found.residuals)} poses: {1e3 * shift_m:.2f} mm, {math.degrees(turn_rad):.3f} deg (rms); "
        f"held out: {1e3 * out_m:.2f} mm, {math.degrees(out_rad):.3f} deg",
        f"camera's mount, one sigma along and about the arm's axes: {sigma_mm} mm, {sigma_deg} deg",
    ]
    outliers = [residual.name for residual in found.residuals if residual.outlier]
    if outliers:
        lines.append(f"outliers: {', '.join(outliers)}; was the arm still, and are these its angles? take them away")
    before = transform_from_xyz_rpy(config.rig.camera_xyz_m, config.rig.camera_rpy_rad)
    after = transform_from_xyz_rpy(xyz_m, rpy_rad)
    moved_m = float(np.linalg.norm(after.translation_m - before.translation_m))
    cosine = (float(np.trace(after.rotation.T @ before.rotation)) - 1.0) / 2.0
    lines.append(
        f"against the configuration: {1e3 * moved_m:.1f} mm, {math.degrees(math.acos(max(-1.0, min(1.0, cosine)))):.2f}"
        " deg" + ("; so far? check the URDF, the order of the joints and rig.arm_xyz_m" if moved_m > _FAR_M else "")
    )
    return [*lines, "[rig]", f"camera_xyz_m = {xyz_m}", f"camera_rpy_rad = {rpy_rad}"]


def _say(line: str) -> None:
    Console().print(line, highlight=False, soft_wrap=True, markup=False)

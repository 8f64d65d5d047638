"""``sprayer calibrate check``: whether a calibration still holds, by pairs of the board or of any scene."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from rich.console import Console
from rich.table import Table

from drivers.camera.epipolar import SHIFT_LIMIT_PX, Misalignment, Rectifier, StereoCalibration, Verdict, misalignment
from drivers.camera.view_matching import Matches, match
from robot.calibration_file import load_rig
from robot.commands.board_images import find_boards, parse_board
from robot.errors import ConfigError, FileError, UsageError
from robot.image_folder import ImagePair, find_pairs, read_grey_image
from robot.vision.board_corners import Board
from robot.vision.board_pose import estimate_board_pose
from robot.vision.board_scale import measure_board
from robot.vision.camera_calibration import BoardView
from robot.vision.stereo_rig import StereoRig

SCALE_LIMIT = 0.005
AT_M = 0.5  # a typical distance of fruit
_FAILED = 1


def calibrate_check(
    images: Annotated[Path, typer.Argument(metavar="DIR", help="Pairs <id>_left.* and <id>_right.*")],
    calibration: Annotated[Path, typer.Option("--calibration", metavar="FILE", help="The calibration to check.")],
    board: Annotated[
        str | None, typer.Option("--board", metavar="COLSxROWS", help="The pairs show this board; else any scene does.")
    ] = None,
    square_m: Annotated[float | None, typer.Option("--square-m", metavar="M", help="Side of its squares.")] = None,
    limit_px: Annotated[
        float, typer.Option("--limit-px", min=0.1, max=5.0, help="Error from which on it counts as decalibrated.")
    ] = SHIFT_LIMIT_PX,
) -> int:
    """Tell whether a calibration still holds. Exit code 1 when it does not, or when these pairs cannot tell."""
    if (board is None) != (square_m is None):
        raise UsageError("--board and --square-m belong together; give both for pairs of the board, none for a scene")
    rig = load_rig(calibration)
    pairs = find_pairs(images)
    if board is not None and square_m is not None:
        return _by_board(pairs, parse_board(board, square_m), rig, calibration, limit_px)
    return _by_scene(pairs, rig, calibration, limit_px)


def scene_matches(pairs: Sequence[ImagePair], rig: StereoRig, calibration: Path) -> Matches:
    """Points that both views show, of all pairs together. ``ConfigError`` for pairs of another size."""
    found: list[Matches] = []
    for pair in pairs:
        views = [read_grey_image(path) for path in (pair.left, pair.right)]
        for path, view in zip((pair.left, pair.right), views, strict=True):
            _check_size((view.shape[1], view.shape[0]), path, rig, calibration)
        found.append(match(*views))
    return Matches(np.concatenate([each.left for each in found]), np.concatenate([each.right for each in found]))


def judge(matches: Matches, rig: StereoRig) -> Misalignment:
    """``FileError`` when there is next to nothing to judge by."""
    if len(matches) < 3:
        raise FileError(
            f"found {len(matches)} points that both views show, 30 or more are needed; give more pairs, with leaves or "
            "print in view and in daylight"
        )
    rectify = Rectifier(
        StereoCalibration(rig.image_size, rig.K_left, rig.dist_left, rig.K_right, rig.dist_right, rig.R, rig.t_m)
    )
    return misalignment(*rectify(matches), rectify.focal_px)


def _by_scene(pairs: Sequence[ImagePair], rig: StereoRig, calibration: Path, limit_px: float) -> int:
    found = judge(scene_matches(pairs, rig, calibration), rig)
    verdict = found.verdict(limit_px)
    _say(f"{len(pairs)} pairs: {found}")
    if verdict is Verdict.UNSURE:
        _say(f"cannot tell: {found.matches} points are too few or too uncertain; give more pairs, or use the board")
        return _FAILED
    _say(
        "a turn in yaw shifts every distance and hardly shows in rows: these pairs tell it to "
        f"{_depth_mm(3.0 * found.disparity_sigma_px, rig):.0f} mm at {AT_M:g} m; the board tells it better"
    )
    return _conclude(verdict, found, rig, calibration)


def _by_board(pairs: Sequence[ImagePair], board: Board, rig: StereoRig, calibration: Path, limit_px: float) -> int:
    search = find_boards([(pair.scene_id, pair.left, pair.right) for pair in pairs], board)
    _check_size(search.image_size, pairs[0].left, rig, calibration)
    for skipped in search.skipped:
        _say(f"skipped {skipped.path}: {skipped.why}")
    if not search.views:
        raise FileError(
            f"{pairs[0].left.parent}: found the {board.columns}x{board.rows} board in both images of none of "
            f"{len(pairs)} pairs; check --board, and show the whole board to both lenses"
        )
    try:
        rms_px, scale = _table_of(search.views, board, rig)
    except ValueError as error:
        raise FileError(f"{pairs[0].left.parent}: {error}") from error
    left, right = (np.concatenate(side) for side in zip(*((v.left_px, v.right_px) for v in search.views), strict=True))
    found = judge(Matches(left, right), rig)
    _say(f"{len(search.views)} pairs of the board: {found}")
    _say(f"reprojection {rms_px:.2f} px, size of the board off by {1e2 * scale:+.2f} % (limits {limit_px:g} px, "
         f"{1e2 * SCALE_LIMIT:g} %)")  # fmt: skip
    if abs(scale) > SCALE_LIMIT and max(rms_px, found.shift_px, abs(found.disparity_px)) <= limit_px:
        _say(
            f"{calibration}: disagrees with the board in size alone, by {1e2 * scale:+.2f} %: measure the board's "
            "squares and check that it lies flat; if they are right, calibrate again"
        )
        return _FAILED
    worse = found.shift_px > limit_px or rms_px > limit_px or abs(scale) > SCALE_LIMIT
    return _conclude(Verdict.DECALIBRATED if worse else Verdict.HOLDS, found, rig, calibration)


def _table_of(views: Sequence[BoardView], board: Board, rig: StereoRig) -> tuple[float, float]:
    """Prints each view; gives the root mean square reprojection error (px) and the mean scale error."""
    table = Table(title="The board through the calibration")
    for column in ("view", "distance, m", "reprojection, px", "size, %", "square, mm", "flat to, mm"):
        table.add_column(column, justify="left" if column == "view" else "right")
    errors, scales = [], []
    for view in views:
        pose, scale = estimate_board_pose(view, board, rig), measure_board(view, board, rig)
        errors.append(pose.rms_px)
        scales.append(scale.scale_error)
        table.add_row(
            view.name, f"{scale.distance_m:.3f}", f"{pose.rms_px:.3f}", f"{1e2 * scale.scale_error:+.2f}",
            f"{1e3 * scale.square_rms_m:.2f}", f"{1e3 * scale.flatness_rms_m:.2f}",
        )  # fmt: skip
    Console().print(table)
    return math.sqrt(float(np.mean(np.square(errors)))), float(np.mean(scales))


def _conclude(verdict: Verdict, found: Misalignment, rig: StereoRig, calibration: Path) -> int:
    if verdict is Verdict.HOLDS:
        _say(f"{calibration}: the calibration holds: {found.shift_px:.1f} px")
        return 0
    by_px, depth = found.shift_px, ""
    if abs(found.disparity_px) > 4.0 * found.disparity_sigma_px:
        by_px = max(by_px, abs(found.disparity_px))
        depth = f", distances at {AT_M:g} m off by about {_depth_mm(found.disparity_px, rig):.0f} mm"
    _say(
        f"{calibration}: decalibrated by {by_px:.1f} px{depth}; fasten the lenses and calibrate again: "
        "sprayer calibrate camera"
    )
    return _FAILED


def _depth_mm(disparity_px: float, rig: StereoRig) -> float:
    return 1e3 * abs(disparity_px) * AT_M**2 / (float(rig.K_left[0, 0]) * rig.baseline_m)


def _check_size(size: tuple[int, int], path: Path, rig: StereoRig, calibration: Path) -> None:
    if size != rig.image_size:
        (width, height), (wide, high) = rig.image_size, size
        raise ConfigError(
            f"{calibration}: the calibration is for {width}x{height} pixels, {path.name} has {wide}x{high}; "
            "give the calibration of this camera at this size"
        )


def _say(line: str) -> None:
    Console().print(line, highlight=False, soft_wrap=True, markup=False)

"""``sprayer calibrate camera``: the stereo pair from views of a chessboard."""

from __future__ import annotations

import glob
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.table import Table

from robot.calibration_file import save_rig
from robot.commands.board_images import BoardOption, SquareOption, find_boards, parse_board
from robot.errors import FileError, UsageError
from robot.vision.board_coverage import Coverage, coverage
from robot.vision.camera_calibration import MIN_VIEWS, StereoCalibration, calibrate_stereo
from robot.vision.held_out import HeldOut, RigErrors, hold_out, judge_rig

app = typer.Typer(help="Calibrate a device.", no_args_is_help=True)


@app.callback()
def calibrate() -> None:
    """Calibrate a device."""


@app.command("camera")
def calibrate_camera(
    left: Annotated[str, typer.Option("--left", metavar="GLOB", help="Quoted pattern of the left images.")],
    right: Annotated[str, typer.Option("--right", metavar="GLOB", help="Quoted pattern of the right images.")],
    board: BoardOption,
    square_m: SquareOption,
    out: Annotated[Path, typer.Option("--out", metavar="FILE", help="The calibration, JSON.")],
    world_view: Annotated[
        int | None,
        typer.Option("--world-view", min=1, metavar="N", help="Take the board of the N-th view as the world's frame."),
    ] = None,
) -> None:
    """Calibrate the stereo camera from views of a chessboard."""
    chessboard = parse_board(board, square_m)
    files = pair_views(_files("--left", left), _files("--right", right))
    if world_view is not None and world_view > len(files):
        raise UsageError(f"--world-view {world_view}: there are {len(files)} views; give 1 to {len(files)}")
    search = find_boards([(left_path.name, left_path, right_path) for left_path, right_path in files], chessboard)
    console = Console()
    for skipped in search.skipped:
        console.print(f"skipped {skipped.path}: {skipped.why}", highlight=False, soft_wrap=True)
    world_name = None if world_view is None else files[world_view - 1][0].name
    if len(search.views) < MIN_VIEWS:
        missing = f" (not in {search.skipped[0].path}: {search.skipped[0].why})" if search.skipped else ""
        raise FileError(
            f"{left}: found the {board} board in both images of {len(search.views)} of {len(files)} views{missing}; "
            f"check --board and take at least {MIN_VIEWS} views that show the whole board"
        )
    try:
        calibration = calibrate_stereo(search.views, chessboard, search.image_size, world_name)
        errors = judge_rig(search.views, chessboard, calibration.rig)
    except ValueError as error:
        raise FileError(f"{left}: {error}") from error
    save_rig(out, calibration.rig)
    console.print(_table(calibration))
    try:
        held_out: HeldOut | str = hold_out(search.views, chessboard, search.image_size)
    except ValueError as error:
        held_out = str(error)
    covered = coverage(search.views, chessboard, search.image_size, float(calibration.rig.K_left[0, 0]))
    lines = [
        *_summary(calibration, len(files)), *_held_out_lines(errors, held_out), *coverage_lines(covered),
        f"written: {out}",
    ]  # fmt: skip
    for line in lines:
        console.print(line, highlight=False, soft_wrap=True)


def pair_views(left: Sequence[Path], right: Sequence[Path]) -> list[tuple[Path, Path]]:
    """Left and right files whose names differ in the side alone, in natural order; ``FileError`` names a lone one."""
    by_key: list[dict[str, Path]] = []
    for paths in (left, right):
        keyed: dict[str, Path] = {}
        for path in paths:
            key = re.sub(r"left|right", "*", path.stem, flags=re.IGNORECASE)
            if key in keyed:
                raise FileError(f"{path}: the same view as {keyed[key]}; narrow the pattern")
            keyed[key] = path
        by_key.append(keyed)
    for (side, own), others in zip((("left", by_key[0]), ("right", by_key[1])), reversed(by_key), strict=True):
        for key, path in own.items():
            if key not in others:
                other = "right" if side == "left" else "left"
                raise FileError(
                    f"{path}: no {other} image of the same name but for 'left' and 'right'; "
                    f"add it or take {path.name} away"
                )
    return [(by_key[0][key], by_key[1][key]) for key in sorted(by_key[0], key=_natural)]


def coverage_lines(covered: Coverage) -> list[str]:
    """What the views have shown, and what to show next."""
    if covered.complete:
        return [f"coverage: complete ({covered.cell_share:.0%} of both images, all tilts and distances)"]
    missing = [*covered.missing_regions, *covered.missing_tilts, *covered.missing_distances]
    return [
        f"coverage: {covered.cell_share:.0%} of both images; too little of: {', '.join(missing)}",
        f"next view: {covered.advice}",
    ]


def _files(option: str, pattern: str) -> list[Path]:
    found = [Path(name) for name in sorted(glob.glob(pattern, recursive=True))]
    files = [path for path in found if path.is_file()]
    if not files:
        raise FileError(f"{option} {pattern}: no such files; quote the pattern and check it")
    return files


def _natural(text: str) -> list[tuple[int, str]]:
    return [(int(part), "") if part.isdigit() else (-1, part) for part in re.split(r"(\d+)", text)]


def _table(calibration: StereoCalibration) -> Table:
    table = Table(title="Reprojection error (rms, px)")
    table.add_column("view")
    for column in ("left", "right", "both"):
        table.add_column(column, justify="right")
    for view in calibration.views:
        style = "red" if view.outlier else None
        table.add_row(view.name, f"{view.left_px:.3f}", f"{view.right_px:.3f}", f"{view.rms_px:.3f}", style=style)
    return table


def _summary(calibration: StereoCalibration, views: int) -> list[str]:
    rig = calibration.rig
    lines = [
        f"rms: left {calibration.left_rms_px:.3f} px, right {calibration.right_rms_px:.3f} px, "
        f"stereo {calibration.stereo_rms_px:.3f} px ({len(calibration.views)} of {views} views)",
        f"focal length: left {rig.K_left[0, 0]:.2f}, {rig.K_left[1, 1]:.2f} px, "
        f"right {rig.K_right[0, 0]:.2f}, {rig.K_right[1, 1]:.2f} px (one sigma {calibration.focal_sigma_px:.2f} px)",
        f"baseline: {rig.baseline_m * 1e3:.2f} mm",
    ]
    names = [view.name for view in calibration.views if view.outlier]
    if names:
        lines.append(f"outliers: {', '.join(names)}; look at these images and calibrate again without the bad ones")
    return lines


def _held_out_lines(errors: RigErrors, held_out: HeldOut | str) -> list[str]:
    lines = [f"all views: {_errors(errors)}"]
    if isinstance(held_out, str):
        return [*lines, f"views held out: not judged ({held_out})"]
    lines.append(f"views held out: {_errors(held_out.held_out)}")
    if held_out.much_worse:
        lines.append(
            f"warning: {held_out.held_out.rms_px:.3f} px on views held out against {held_out.used.rms_px:.3f} px on "
            "those used: these views do not determine the lenses; add views as advised below and calibrate again"
        )
    return lines


def _errors(errors: RigErrors) -> str:
    return (
        f"{errors.rms_px:.3f} px; triangulated board: size off by {1e2 * errors.scale_rms:.2f} %, "
        f"squares by {1e3 * errors.square_rms_m:.2f} mm, flat to {1e3 * errors.flatness_rms_m:.2f} mm (rms)"
    )

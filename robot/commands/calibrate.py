"""``sprayer calibrate camera``: the stereo pair from views of a chessboard."""

from __future__ import annotations

import glob
import re
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.table import Table

from robot.calibration_file import save_rig
from robot.errors import FileError, UsageError
from robot.image_folder import Image, read_grey_image, size_text
from robot.vision.board_corners import Array, Board, find_corners, same_order
from robot.vision.camera_calibration import MIN_VIEWS, BoardView, StereoCalibration, calibrate_stereo

app = typer.Typer(help="Calibrate a device.", no_args_is_help=True)


@app.callback()
def calibrate() -> None:
    """Calibrate a device."""


@app.command("camera")
def calibrate_camera(
    left: Annotated[str, typer.Option("--left", metavar="GLOB", help="Quoted pattern of the left images.")],
    right: Annotated[str, typer.Option("--right", metavar="GLOB", help="Quoted pattern of the right images.")],
    board: Annotated[str, typer.Option("--board", metavar="COLSxROWS", help="Inner corners of the chessboard.")],
    square_m: Annotated[float, typer.Option("--square-m", metavar="M", help="Side of a square in metres.")],
    out: Annotated[Path, typer.Option("--out", metavar="FILE", help="The calibration, JSON.")],
    world_view: Annotated[
        int | None,
        typer.Option("--world-view", min=1, metavar="N", help="Take the board of the N-th view as the world's frame."),
    ] = None,
) -> None:
    """Calibrate the stereo camera from views of a chessboard."""
    chessboard = _board(board, square_m)
    files = pair_views(_files("--left", left), _files("--right", right))
    if world_view is not None and world_view > len(files):
        raise UsageError(f"--world-view {world_view}: there are {len(files)} views; give 1 to {len(files)}")
    search = _search(files, chessboard)
    console = Console()
    for path in search.without_board:
        console.print(f"skipped: no {board} board found in {path}", highlight=False, soft_wrap=True)
    world_name = None if world_view is None else files[world_view - 1][0].name
    if len(search.views) < MIN_VIEWS:
        missing = f" (not in {search.without_board[0]})" if search.without_board else ""
        raise FileError(
            f"{left}: found the {board} board in both images of {len(search.views)} of {len(files)} views{missing}; "
            f"check --board and take at least {MIN_VIEWS} views that show the whole board"
        )
    try:
        calibration = calibrate_stereo(search.views, chessboard, search.image_size, world_name)
    except ValueError as error:
        raise FileError(f"{left}: {error}") from error
    save_rig(out, calibration.rig)
    console.print(_table(calibration))
    for line in _summary(calibration, len(files), out):
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


@dataclass(frozen=True, slots=True, eq=False)
class _Search:
    views: list[BoardView]
    without_board: list[Path]
    image_size: tuple[int, int]


def _search(files: Sequence[tuple[Path, Path]], board: Board) -> _Search:
    first = read_grey_image(files[0][0])

    def corners_of(path: Path) -> Array | None:
        image: Image = read_grey_image(path)
        if image.shape != first.shape:
            raise FileError(
                f"{path}: is {size_text(image)}, {files[0][0].name} is {size_text(first)}; "
                "all views of a calibration must have one size"
            )
        return find_corners(image, board)

    with ThreadPoolExecutor(max_workers=4) as pool:
        left = list(pool.map(corners_of, [pair[0] for pair in files]))
        right = list(pool.map(corners_of, [pair[1] for pair in files]))
    views, without_board = [], []
    for (left_path, right_path), left_px, right_px in zip(files, left, right, strict=True):
        if left_px is not None and right_px is not None:
            views.append(BoardView(left_path.name, left_px, same_order(left_px, right_px)))
        else:
            without_board.append(left_path if left_px is None else right_path)
    return _Search(views, without_board, (first.shape[1], first.shape[0]))


def _board(text: str, square_m: float) -> Board:
    match = re.fullmatch(r"(\d{1,3})x(\d{1,3})", text)
    if match is None:
        raise UsageError(f"--board {text}: expected inner corners as COLUMNSxROWS, for example 7x5")
    try:
        return Board(int(match[1]), int(match[2]), square_m)
    except ValueError as error:
        raise UsageError(f"--board {text} --square-m {square_m:g}: {error}") from error


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


def _summary(calibration: StereoCalibration, views: int, out: Path) -> list[str]:
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
    return [*lines, f"written: {out}"]

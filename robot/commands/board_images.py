"""Views of a chessboard from image files, for the commands that calibrate and check."""

from __future__ import annotations

import re
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from robot.errors import FileError, UsageError
from robot.image_folder import Image, read_grey_image, size_text
from robot.vision.board_corners import Board, measure_corners, same_order, unfit_for_calibration
from robot.vision.camera_calibration import BoardView
from robot.vision.corner_fit import CornerFit

BoardOption = Annotated[str, typer.Option("--board", metavar="COLSxROWS", help="Inner corners of the chessboard.")]
SquareOption = Annotated[float, typer.Option("--square-m", metavar="M", help="Side of a square in metres.")]


@dataclass(frozen=True, slots=True)
class Skipped:
    """A view that cannot be used, and why."""

    path: Path
    why: str


@dataclass(frozen=True, slots=True, eq=False)
class BoardSearch:
    """``views`` in the order of the files; ``image_size`` (width, height) of all of them."""

    views: list[BoardView]
    skipped: list[Skipped]
    image_size: tuple[int, int]


def parse_board(text: str, square_m: float) -> Board:
    """``UsageError`` for what is no board."""
    match = re.fullmatch(r"(\d{1,3})x(\d{1,3})", text)
    if match is None:
        raise UsageError(f"--board {text}: expected inner corners as COLUMNSxROWS, for example 7x5")
    try:
        return Board(int(match[1]), int(match[2]), square_m)
    except ValueError as error:
        raise UsageError(f"--board {text} --square-m {square_m:g}: {error}") from error


def find_boards(files: Sequence[tuple[str, Path, Path]], board: Board) -> BoardSearch:
    """Views named by the first of each triple from the left and right file. ``FileError`` for images of two sizes."""
    first_path = files[0][1]
    first = read_grey_image(first_path)

    def corners_of(path: Path) -> CornerFit | None:
        image: Image = read_grey_image(path)
        if image.shape != first.shape:
            raise FileError(
                f"{path}: is {size_text(image)}, {first_path.name} is {size_text(first)}; "
                "all views of a calibration must have one size"
            )
        return measure_corners(image, board)

    with ThreadPoolExecutor(max_workers=4) as pool:
        left = list(pool.map(corners_of, [left_path for _, left_path, _ in files]))
        right = list(pool.map(corners_of, [right_path for _, _, right_path in files]))
    views: list[BoardView] = []
    skipped: list[Skipped] = []
    for (name, left_path, right_path), in_left, in_right in zip(files, left, right, strict=True):
        reasons = [
            Skipped(path, why)
            for path, fit in ((left_path, in_left), (right_path, in_right))
            if (why := _why_unusable(fit, board)) is not None
        ]
        if in_left is None or in_right is None or reasons:
            skipped.append(reasons[0])
        else:
            views.append(BoardView(name, in_left.points_px, same_order(in_left.points_px, in_right.points_px)))
    return BoardSearch(views, skipped, (first.shape[1], first.shape[0]))


def _why_unusable(fit: CornerFit | None, board: Board) -> str | None:
    if fit is None:
        return f"no {board.columns}x{board.rows} board found"
    return unfit_for_calibration(fit)

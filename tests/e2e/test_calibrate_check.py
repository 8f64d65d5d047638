"""``sprayer calibrate check`` from files to a verdict and an exit code."""

from __future__ import annotations

import json
import os
import re
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from robot.calibration_file import load_rig, save_rig
from robot.cli import run_command
from robot.geometry import Transform, rotation_from_rpy
from robot.vision.board_corners import Board
from robot.vision.stereo_rig import StereoRig
from tests.robot.vision.boards import board_photo
from tests.robot.vision.chess_set import GREENHOUSE, needs_chess_set
from tests.robot.vision.spheres import small_rig

BOARD = Board(7, 5, 0.03)
RIG = small_rig(tilted=True)
USAGE, FILE, CONFIG = 64, 74, 78


def turned(rig: StereoRig, *rpy_px: float) -> StereoRig:
    """A calibration that says the right eye is turned about x, y, z by the angles of so many pixels."""
    turn = rotation_from_rpy(*(pixels / float(rig.K_left[0, 0]) for pixels in rpy_px))
    return replace(rig, R=turn @ rig.R, t_m=turn @ rig.t_m)


@pytest.fixture(scope="module")
def board_pairs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two pairs of the board, and calibrations beside the folder: the true one and turned ones."""
    folder = tmp_path_factory.mktemp("check") / "pairs"
    folder.mkdir()
    for index, turn in enumerate((rotation_from_rpy(0.3, 0.2, 0.1), rotation_from_rpy(-0.2, 0.35, -0.1))):
        middle = turn @ BOARD.points_m().mean(axis=0)
        placed = Transform(turn, np.array([0.02, 0.01, 0.36 + 0.05 * index]) - middle)
        for side in ("left", "right"):
            cv2.imwrite(str(folder / f"board{index}_{side}.png"), board_photo(RIG, side, BOARD, placed, seed=index))
    save_rig(folder.parent / "true.json", RIG)
    save_rig(folder.parent / "pitch.json", turned(RIG, 1.0, 0.0, 0.0))
    save_rig(folder.parent / "yaw.json", turned(RIG, 0.0, 1.0, 0.0))
    return folder


def check(folder: Path, calibration: Path, *options: str) -> int:
    return run_command(["calibrate", "check", str(folder), "--calibration", str(calibration), *options])


WITH_BOARD = ("--board", "7x5", "--square-m", "0.03")


def test_two_pairs_of_the_board_show_that_a_calibration_holds(
    board_pairs: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert check(board_pairs, board_pairs.parent / "true.json", *WITH_BOARD) == 0
    assert "true.json: the calibration holds: 0.0 px" in capsys.readouterr().out


@pytest.mark.parametrize(("name", "words"), [("pitch", ("by 1.0 px",)), ("yaw", ("by 1.1 px", "distances at 0.5 m"))])
def test_two_pairs_of_the_board_show_a_lens_turned_by_a_pixel(
    board_pairs: Path, capsys: pytest.CaptureFixture[str], name: str, words: tuple[str, ...]
) -> None:
    assert check(board_pairs, board_pairs.parent / f"{name}.json", *WITH_BOARD) == 1
    shown = capsys.readouterr().out
    assert f"{name}.json: decalibrated" in shown
    for word in words:
        assert word in shown


def test_a_board_of_larger_squares_is_told_from_a_turned_lens(
    board_pairs: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert check(board_pairs, board_pairs.parent / "true.json", "--board", "7x5", "--square-m", "0.0306") == 1
    shown = capsys.readouterr().out
    off = re.search(r"disagrees with the board in size alone, by (\S+) %: measure the board's squares", shown)
    assert off is not None
    assert float(off[1]) == pytest.approx(100.0 * (0.03 / 0.0306 - 1.0), abs=0.2)


@pytest.mark.parametrize(
    ("calibration", "options", "exit_code", "words"),
    [
        ("true.json", ("--board", "7x5"), USAGE, ("--square-m",)),
        ("true.json", ("--board", "9x6", "--square-m", "0.03"), FILE, ("9x6 board", "none of 2 pairs")),
        ("gone.json", (), CONFIG, ("gone.json",)),
        ("large.json", WITH_BOARD, CONFIG, ("640x480", "320x240")),
        ("large.json", (), CONFIG, ("640x480", "320x240")),
    ],
)
def test_what_cannot_be_checked_is_refused(
    board_pairs: Path, capsys: pytest.CaptureFixture[str], calibration: str, options: tuple[str, ...], exit_code: int,
    words: tuple[str, ...],
) -> None:  # fmt: skip
    K = np.array([[458.0, 0.0, 320.0], [0.0, 458.0, 240.0], [0.0, 0.0, 1.0]])
    save_rig(board_pairs.parent / "large.json", replace(RIG, image_size=(640, 480), K_left=K, K_right=K))
    assert check(board_pairs, board_pairs.parent / calibration, *options) == exit_code
    error = capsys.readouterr().err
    for word in words:
        assert word in error


def test_a_wall_without_anything_on_it_cannot_tell(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for side in ("left", "right"):
        cv2.imwrite(str(tmp_path / f"wall_{side}.png"), np.full((240, 320), 120, dtype=np.uint8))
    save_rig(tmp_path / "rig.json", RIG)
    assert check(tmp_path, tmp_path / "rig.json") == FILE
    assert "found 0 points that both views show" in capsys.readouterr().err


@pytest.fixture(scope="module")
def scenes(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The greenhouse pairs that the distorted rig took."""
    folder = tmp_path_factory.mktemp("scenes") / "pairs"
    folder.mkdir()
    for sidecar in sorted((GREENHOUSE / "dev").glob("dev_*.json")):
        if json.loads(sidecar.read_text())["rig"] == "real":
            for side in ("left", "right"):
                os.symlink(sidecar.parent / f"{sidecar.stem}_{side}.jpg", folder / f"{sidecar.stem}_{side}.jpg")
    true = load_rig(GREENHOUSE / "calib_real.json")
    save_rig(folder.parent / "true.json", true)
    turns_px = {"up": (1.0, 0, 0), "down": (-1.0, 0, 0), "rolled": (0, 0, 2.5), "knocked": (0, 6.0, 0)}
    for name, turn_px in turns_px.items():
        save_rig(folder.parent / f"{name}.json", turned(true, *turn_px))
    return folder


@needs_chess_set
def test_greenhouse_scenes_show_that_a_calibration_holds(scenes: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert check(scenes, scenes.parent / "true.json") == 0
    assert "the calibration holds: 0.0 px" in capsys.readouterr().out


@needs_chess_set
@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("up", ("decalibrated by 1.1 px", "0.12 deg in pitch")),
        ("down", ("decalibrated by 1.1 px", "-0.13 deg in pitch")),
        ("rolled", ("decalibrated by 0.9 px", "0.32 in roll")),
        ("knocked", ("decalibrated by 5.9 px", "distances at 0.5 m")),
    ],
)
def test_greenhouse_scenes_show_a_lens_turned_by_a_pixel(
    scenes: Path, capsys: pytest.CaptureFixture[str], name: str, words: tuple[str, ...]
) -> None:
    assert check(scenes, scenes.parent / f"{name}.json") == 1
    shown = capsys.readouterr().out
    for word in words:
        assert word in shown

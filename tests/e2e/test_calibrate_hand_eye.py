"""``sprayer calibrate hand-eye`` from pictures and joint angles to the mount in a configuration."""

from __future__ import annotations

import json
import shutil
import tomllib
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from robot.calibration_file import save_rig
from robot.cli import run_command
from robot.geometry import body_from_optical, transform_from_xyz_rpy
from robot.package_files import packaged
from tests.robot.arm_with_board import BASE_FROM_ARM, BOARD, show
from tests.robot.vision.boards import board_photo
from tests.robot.vision.spheres import small_rig

RIG = small_rig(tilted=True)
XYZ_M, RPY_RAD = (-0.027, 0.056, 0.873), (0.012, -0.02, np.pi / 2 + 0.015)
FILE, CONFIG = 74, 78


@pytest.fixture(scope="module")
def taken(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Ten pairs in which the arm shows the board, their joint angles, and a configuration of that camera."""
    folder = tmp_path_factory.mktemp("hand_eye")
    (folder / "pairs").mkdir()
    camera = transform_from_xyz_rpy(XYZ_M, RPY_RAD) @ body_from_optical()
    lines = []
    for index, shown in enumerate(show(10, RIG, BASE_FROM_ARM.inverse() @ camera, seed=4)):
        for side in ("left", "right"):
            picture = board_photo(RIG, side, BOARD, shown.camera_from_board, seed=index)
            cv2.imwrite(str(folder / f"pairs/{shown.name}_{side}.png"), picture)
        lines.append(json.dumps({"id": shown.name, "joints_rad": shown.joints_rad.tolist()}))
    (folder / "joints.jsonl").write_text("\n".join(lines) + "\n")
    save_rig(folder / "rig.json", RIG)
    text = (packaged("configs") / "demo.toml").read_text()
    text = text.replace('calibration = "calibration/demo.json"', 'calibration = "rig.json"')
    (folder / "rover.toml").write_text(text.replace("[640, 480]", "[320, 240]"))
    return folder


@pytest.fixture
def folder(taken: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(taken, tmp_path / "copy"))


def hand_eye(folder: Path, *options: str) -> int:
    base = ["calibrate", "hand-eye", str(folder / "pairs"), "--joints", str(folder / "joints.jsonl")]
    board = ["--board", "7x5", "--square-m", "0.03"]
    return run_command([*base, "--config", str(folder / "rover.toml"), *board, *options])


def test_the_mount_is_found_and_written_into_the_configuration(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    config = folder / "rover.toml"
    before = config.read_text()
    assert hand_eye(folder, "--write", str(config)) == 0
    rig = tomllib.loads(config.read_text())["rig"]
    assert rig["camera_xyz_m"] == pytest.approx(XYZ_M, abs=0.5e-3)
    assert rig["camera_rpy_rad"] == pytest.approx(RPY_RAD, abs=np.radians(0.05))
    unlike = [new for old, new in zip(before.splitlines(), config.read_text().splitlines(), strict=True) if old != new]
    assert [line.split(" = ")[0] for line in unlike] == ["camera_xyz_m", "camera_rpy_rad"]
    shown = capsys.readouterr().out
    assert "10 poses: 0." in shown
    assert "against the configuration: 9." in shown
    assert f"camera_xyz_m = {rig['camera_xyz_m']}" in shown


def test_without_write_nothing_is_changed(folder: Path) -> None:
    before = (folder / "rover.toml").read_bytes()
    assert hand_eye(folder) == 0
    assert (folder / "rover.toml").read_bytes() == before


def rewrite(folder: Path, change: Callable[[list[dict[str, object]]], object]) -> None:
    lines = [json.loads(line) for line in (folder / "joints.jsonl").read_text().splitlines()]
    change(lines)
    (folder / "joints.jsonl").write_text("\n".join(json.dumps(line) for line in lines))


def set_angles(lines: list[dict[str, object]], angles: list[float]) -> None:
    lines[3]["joints_rad"] = angles


@pytest.mark.parametrize(
    ("change", "exit_code", "words"),
    [
        (lambda lines: lines.pop(2), FILE, ("no angles for the pair 'pose03'",)),
        (lambda lines: lines[2].update(id="pose33"), FILE, ("no angles for the pair 'pose03'",)),
        (lambda lines: lines.append({"id": "pose11", "joints_rad": [0.0] * 6}), FILE, ("no pair 'pose11'",)),
        (lambda lines: lines.append(dict(lines[0])), FILE, ("line 11", "'pose01' was there already")),
        (lambda lines: set_angles(lines, [0.1] * 5), FILE, ("line 4", "must be 6 numbers")),
        (lambda lines: set_angles(lines, [float("nan")] * 6), FILE, ("line 4", "finite")),
        (lambda lines: set_angles(lines, [45.0] * 6), FILE, ("line 4", "are they degrees?")),
        (lambda lines: set_angles(lines, [0.0, 0.0, 0.0, 0.0, 3.0, 0.0]), FILE, ("'pose04' is outside the limits",)),
        (lambda lines: lines[3].update(joints=[0.0] * 6), FILE, ("line 4", "expected {")),
    ],
)
def test_joint_angles_that_do_not_fit_are_refused(
    folder: Path, capsys: pytest.CaptureFixture[str], change: Callable[[list[dict[str, object]]], object],
    exit_code: int, words: tuple[str, ...],
) -> None:  # fmt: skip
    rewrite(folder, change)
    assert hand_eye(folder, "--write", str(folder / "rover.toml")) == exit_code
    error = capsys.readouterr().err
    for word in words:
        assert word in error


def test_too_few_poses_with_the_board_are_refused(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for index in range(5, 11):
        path = folder / f"pairs/pose{index:02d}_right.png"
        cv2.imwrite(str(path), np.full((240, 320), 90, dtype=np.uint8))
    assert hand_eye(folder) == FILE
    told = capsys.readouterr()
    assert "found 4" in told.err
    assert "pose05_right.png: no 7x5 board found" in told.out


def test_pictures_of_another_size_than_the_calibration_are_refused(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for path in (folder / "pairs").iterdir():
        cv2.imwrite(str(path), cv2.resize(cv2.imread(str(path)), (640, 480)))
    assert hand_eye(folder) == CONFIG
    assert "640x480" in capsys.readouterr().err


def test_a_calibration_of_another_camera_is_told_by_the_corners(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    save_rig(folder / "rig.json", small_rig(tilted=False))
    assert hand_eye(folder) == FILE
    assert "px from where the camera's calibration puts them" in capsys.readouterr().err


def test_a_configuration_without_the_two_lines_is_refused_before_anything_is_computed(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    other = folder / "other.toml"
    other.write_text("[rig]\nside = 'left'\n")
    assert hand_eye(folder, "--write", str(other)) == CONFIG
    told = capsys.readouterr()
    assert "camera_xyz_m = [numbers]" in told.err
    assert "poses" not in told.out

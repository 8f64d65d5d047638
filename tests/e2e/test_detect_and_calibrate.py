"""``sprayer detect`` and ``sprayer calibrate camera`` from files to files."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from robot.calibration_file import load_rig, save_rig
from robot.cli import run_command
from robot.vision.stereo_rig import StereoRig
from tests.robot.vision.boards import board_pair
from tests.robot.vision.spheres import Ball, photograph, small_rig

SHARED = Path(os.environ.get("SPRAYER_SHARED", Path(__file__).parents[3] / "shared"))
BALL = Ball((-0.02, 0.02, 0.42), 0.09)
USAGE, FILE, CONFIG = 64, 74, 78


@pytest.fixture(scope="module")
def views() -> dict[str, np.ndarray[Any, Any]]:
    """One red ball, seen by the straight and by the tilted rig."""
    out = {}
    for name, tilted in (("straight", False), ("tilted", True)):
        out[f"{name}_left"], out[f"{name}_right"] = photograph([BALL], small_rig(tilted))
    return out


@pytest.fixture
def folder(tmp_path: Path, views: dict[str, np.ndarray[Any, Any]]) -> Path:
    """Two pairs of two rigs with sidecars and a mask, and the two calibrations beside them."""
    images = tmp_path / "images"
    images.mkdir()
    for name, view in views.items():
        cv2.imwrite(str(images / f"{name}.png"), view)
        cv2.imwrite(str(images / f"{name.replace('_', '_mask_')}.png"), view)
    for name, tilted in (("straight", False), ("tilted", True)):
        (images / f"{name}.json").write_text(json.dumps({"calib_file": f"{name}_rig.json"}))
        save_rig(tmp_path / f"{name}_rig.json", small_rig(tilted))
    return images


def detect(folder: Path, *options: str, out: str = "out.jsonl") -> int:
    return run_command(["detect", str(folder), "--out", str(folder.parent / out), "--detector", "paper", *options])


def lines(path: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in path.read_text().splitlines()]


def test_each_pair_is_detected_with_the_calibration_that_its_sidecar_names(folder: Path) -> None:
    assert detect(folder, "--calibration", str(folder.parent)) == 0
    found = lines(folder.parent / "out.jsonl")
    assert [line["scene_id"] for line in found] == ["straight", "tilted"]
    for line in found:
        assert [line["x"], line["y"], line["z"]] == pytest.approx(BALL.centre_m, abs=0.02)
        assert line["diameter"] == pytest.approx(BALL.diameter_m, abs=0.006)
        assert line["ripeness"] == "red"
        assert line["measured"] is True
        assert set(line) == {
            "scene_id", "u", "v", "r_px", "x", "y", "z", "diameter", "ripeness", "measured", "confidence",
        }  # fmt: skip
    centre_px = small_rig(tilted=True).project_left([BALL.centre_m])[0]
    assert [found[1]["u"], found[1]["v"]] == pytest.approx(centre_px, abs=2.0)


def test_one_calibration_file_serves_all_pairs(folder: Path) -> None:
    assert detect(folder, "--calibration", str(folder.parent / "straight_rig.json")) == 0
    assert lines(folder.parent / "out.jsonl")[0]["z"] == pytest.approx(BALL.centre_m[2], abs=0.02)


def test_single_images_give_circles_in_the_order_of_their_names(folder: Path) -> None:
    assert detect(folder, "--mono") == 0
    found = lines(folder.parent / "out.jsonl")
    assert [line["image"] for line in found] == [
        "straight_left.png",
        "straight_right.png",
        "tilted_left.png",
        "tilted_right.png",
    ]
    assert set(found[0]) == {"image", "u", "v", "r_px", "ripeness", "confidence"}


def test_annotated_copies_are_the_left_images_with_something_drawn_at_the_fruit(folder: Path) -> None:
    drawn = folder.parent / "drawn"
    assert detect(folder, "--calibration", str(folder.parent), "--annotate", str(drawn)) == 0
    assert sorted(path.name for path in drawn.iterdir()) == ["straight.jpg", "tilted.jpg"]
    before = cv2.imread(str(folder / "straight_left.png"))
    difference = np.abs(cv2.imread(str(drawn / "straight.jpg")).astype(int) - before.astype(int)).max(axis=2) > 60
    u, v = small_rig(tilted=False).project_left([BALL.centre_m])[0]
    rows, columns = np.nonzero(difference)
    assert len(rows) > 100
    assert np.hypot(columns - u, rows - v).max() < 110  # circle and label


def test_worker_processes_give_the_same_lines_in_the_same_order(folder: Path) -> None:
    for index in range(13):
        for side in ("left", "right"):
            name = "straight" if index % 3 else "tilted"
            os.link(folder / f"{name}_{side}.png", folder / f"copy{index:02d}_{side}.png")
    calibration = str(folder.parent / "straight_rig.json")
    assert detect(folder, "--calibration", calibration, "--workers", "2", out="two.jsonl") == 0
    assert detect(folder, "--calibration", calibration, "--workers", "1", out="one.jsonl") == 0
    two = (folder.parent / "two.jsonl").read_bytes()
    assert two == (folder.parent / "one.jsonl").read_bytes()
    assert two.count(b"\n") >= 10


def refused(
    capsys: pytest.CaptureFixture[str], code: int, exit_code: int, *words: str, out: Path | None = None
) -> None:
    """Exit code, one line naming the thing, nothing written."""
    error = capsys.readouterr().err.strip()
    assert exit_code == code, error
    assert "\n" not in error
    for word in words:
        assert word in error
    assert out is None or not out.exists()
    assert out is None or not list(out.parent.glob("*.part"))
    assert out is None or not list(out.parent.glob(".*.part"))


def test_a_pair_without_its_partner_is_refused(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (folder / "tilted_right.png").unlink()
    code = detect(folder, "--calibration", str(folder.parent))
    refused(capsys, FILE, code, "tilted_left.png", "tilted_right.png is missing", out=folder.parent / "out.jsonl")


def test_an_unreadable_image_is_refused_and_nothing_is_written(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / "tilted_right.png").write_bytes(b"no image")
    code = detect(folder, "--calibration", str(folder.parent))
    refused(capsys, FILE, code, "tilted_right.png: cannot be decoded", out=folder.parent / "out.jsonl")


def test_an_error_in_a_worker_process_ends_all_with_its_one_line(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for index in range(13):
        for side in ("left", "right"):
            os.link(folder / f"straight_{side}.png", folder / f"copy{index:02d}_{side}.png")
    (folder / "tilted_left.png").write_bytes(b"no image")
    code = detect(folder, "--calibration", str(folder.parent / "straight_rig.json"), "--workers", "2")
    refused(capsys, FILE, code, "tilted_left.png: cannot be decoded", out=folder.parent / "out.jsonl")


def test_images_of_two_sizes_in_a_pair_are_refused(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    cv2.imwrite(str(folder / "tilted_right.png"), np.zeros((200, 320, 3), dtype=np.uint8))
    code = detect(folder, "--calibration", str(folder.parent))
    refused(capsys, FILE, code, "tilted_right.png", "320x200", "320x240", out=folder.parent / "out.jsonl")


def test_a_calibration_for_another_size_is_refused(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for side in ("left", "right"):
        cv2.imwrite(str(folder / f"tilted_{side}.png"), np.zeros((480, 640, 3), dtype=np.uint8))
    code = detect(folder, "--calibration", str(folder.parent))
    refused(capsys, CONFIG, code, "tilted_rig.json", "320x240", "640x480", out=folder.parent / "out.jsonl")


@pytest.mark.parametrize(
    ("content", "word"),
    [
        ("{}", "has no 'calib_file'"),
        ("{", "not valid JSON"),
        ('{"calib_file": "../other.json"}', "outside"),
        ('{"calib_file": "gone.json"}', "is not in"),
    ],
)
def test_a_sidecar_that_names_no_calibration_is_refused(
    folder: Path, capsys: pytest.CaptureFixture[str], content: str, word: str
) -> None:
    (folder / "tilted.json").write_text(content)
    code = detect(folder, "--calibration", str(folder.parent))
    refused(capsys, FILE, code, "tilted.json", word, out=folder.parent / "out.jsonl")


def test_a_malformed_calibration_is_refused(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    calibration = folder.parent / "straight_rig.json"
    calibration.write_text(calibration.read_text().replace('"R"', '"rotation"'))
    code = detect(folder, "--calibration", str(calibration))
    refused(capsys, CONFIG, code, "straight_rig.json", "'R' is missing", out=folder.parent / "out.jsonl")


@pytest.mark.parametrize(
    ("options", "word"),
    [
        ([], "need --calibration"),
        (["--mono", "--calibration", "x.json"], "takes no --calibration"),
        (["--mono", "--annotate", "IMAGES"], "the folder of the images themselves"),
        (["--calibration", "OUT"], "would overwrite the calibration"),
    ],
)
def test_contradicting_options_are_refused(
    folder: Path, capsys: pytest.CaptureFixture[str], options: list[str], word: str
) -> None:
    out = folder.parent / "out.jsonl"
    filled = [{"IMAGES": str(folder), "OUT": str(out)}.get(option, option) for option in options]
    refused(capsys, USAGE, detect(folder, *filled), word, out=out)


def test_an_output_folder_that_is_not_there_is_refused(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code = detect(folder, "--mono", out="nowhere/out.jsonl")
    refused(capsys, FILE, code, "nowhere/out.jsonl: cannot be written")


# --- calibrate camera ---

RIG = StereoRig(
    (640, 480),
    np.array([[458.0, 0.0, 322.0], [0.0, 457.0, 238.0], [0.0, 0.0, 1.0]]),
    np.array([[455.0, 0.0, 317.0], [0.0, 456.0, 242.0], [0.0, 0.0, 1.0]]),
    np.zeros(5),
    np.zeros(5),
    np.eye(3),
    np.array([-0.06, 0.0, 0.0]),
)


@pytest.fixture(scope="module")
def board_images(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Nine views of a 7x5 board of 30 mm; view 4 shows none to the right camera."""
    folder = tmp_path_factory.mktemp("boards")
    for index in range(9):
        left, right = board_pair(index, RIG, 0.03)
        cv2.imwrite(str(folder / f"left{index + 1}.png"), left)
        cv2.imwrite(str(folder / f"right{index + 1}.png"), right if index != 3 else np.full_like(right, 90))
    return folder


def calibrate(left: str, right: str, out: Path, *options: str, board: str = "7x5", square: str = "0.03") -> int:
    base = ["calibrate", "camera", "--left", left, "--right", right, "--out", str(out)]
    return run_command([*base, "--board", board, "--square-m", square, *options])


@pytest.mark.long
def test_a_rig_is_recovered_from_pictures_of_a_board(
    board_images: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "rig.json"
    code = calibrate(f"{board_images}/left*.png", f"{board_images}/right*.png", out, "--world-view", "6")
    assert code == 0
    rig = load_rig(out)
    assert rig.K_left[0, 0] == pytest.approx(458.0, rel=0.005)
    assert rig.K_right[0, 0] == pytest.approx(455.0, rel=0.005)
    assert rig.baseline_m == pytest.approx(0.06, abs=0.5e-3)
    assert rig.world_from_left is not None
    shown = capsys.readouterr().out
    assert f"skipped {board_images}/right4.png: no 7x5 board found" in shown
    assert "left9.png" in shown


def test_a_world_view_without_a_board_is_refused(
    board_images: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "rig.json"
    code = calibrate(f"{board_images}/left*.png", f"{board_images}/right*.png", out, "--world-view", "4")
    refused(capsys, FILE, code, "world view left4.png", out=out)


@pytest.mark.parametrize(
    ("left", "right", "options", "exit_code", "word"),
    [
        ("left*.png", "right[1-8].png", {}, FILE, "left9.png: no right image"),
        ("left[1-2].png", "right[1-2].png", {}, FILE, "at least 3"),
        ("left*.png", "right*.png", {"board": "9x6"}, FILE, "in both images of 0 of 9 views"),
        ("left*.png", "right*.png", {"board": "seven"}, USAGE, "COLUMNSxROWS"),
        ("left*.png", "right*.png", {"square": "30"}, USAGE, "0.001..1 m"),
        ("none*.png", "right*.png", {}, FILE, "no such files"),
        ("right*.png", "left*.png", {}, CONFIG, "left and right swapped"),
    ],
)
def test_unusable_views_are_refused_and_nothing_is_written(
    board_images: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    left: str,
    right: str,
    options: dict[str, str],
    exit_code: int,
    word: str,
) -> None:
    out = tmp_path / "rig.json"
    code = calibrate(f"{board_images}/{left}", f"{board_images}/{right}", out, **options)  # type: ignore[arg-type]
    refused(capsys, exit_code, code, word, out=out)


def test_views_of_two_sizes_are_refused(board_images: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for index in (1, 2, 3):
        for side in ("left", "right"):
            image = cv2.imread(str(board_images / f"{side}{index}.png"))
            cv2.imwrite(str(tmp_path / f"{side}{index}.png"), image if index != 2 else image[:-2])
    code = calibrate(f"{tmp_path}/left*.png", f"{tmp_path}/right*.png", tmp_path / "rig.json")
    refused(capsys, FILE, code, "left2.png: is 640x478", out=tmp_path / "rig.json")


needs_shared = pytest.mark.skipif(not SHARED.is_dir(), reason=f"no reference images at {SHARED} (SPRAYER_SHARED)")


@needs_shared
def test_the_rendered_greenhouse_rig_is_recovered(tmp_path: Path) -> None:
    images = SHARED / "data/greenhouse"
    out = tmp_path / "rig.json"
    assert calibrate(f"{images}/chess_*_left.png", f"{images}/chess_*_right.png", out, "--world-view", "6") == 0
    rig, true = load_rig(out), load_rig(images / "calib_real.json")
    for found, expected in ((rig.K_left, true.K_left), (rig.K_right, true.K_right)):
        assert found[0, 0] == pytest.approx(expected[0, 0], rel=0.005)
        assert found[1, 1] == pytest.approx(expected[1, 1], rel=0.005)
    assert rig.baseline_m == pytest.approx(true.baseline_m, abs=0.5e-3)
    pose = json.loads((images / "chess_poses.json").read_text())["poses"][5]
    assert rig.world_from_left is not None
    assert np.linalg.inv(rig.world_from_left)[:3, 3] == pytest.approx(pose["t_m"], abs=1.5e-3)


@pytest.mark.long
@needs_shared
def test_the_real_chessboard_pairs_meet_their_reference(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    images = SHARED / "data/opencv_chessboard"
    out = tmp_path / "rig.json"
    code = calibrate(f"{images}/left??.jpg", f"{images}/right??.jpg", out, board="9x6", square="0.025")
    assert code == 0
    rig = load_rig(out)
    assert rig.K_left[0, 0] == pytest.approx(533.0, rel=0.01)
    assert rig.K_right[0, 0] == pytest.approx(537.5, rel=0.01)
    assert rig.baseline_m == pytest.approx(83.2e-3, rel=0.01)
    shown = capsys.readouterr().out
    assert float(shown.split("stereo ")[1].split(" px")[0]) <= 0.30


@needs_shared
def test_the_papers_method_keeps_its_measured_rate_on_the_rendered_greenhouse(tmp_path: Path) -> None:
    images = SHARED / "data/greenhouse"
    out, scores = tmp_path / "out.jsonl", tmp_path / "scores.json"
    options = ["--calibration", str(images), "--detector", "paper", "--out", str(out)]
    assert run_command(["detect", str(images / "dev"), *options]) == 0
    scorer = [sys.executable, str(SHARED / "bin/score_greenhouse.py"), "--gt", str(images / "dev")]
    subprocess.run([*scorer, "--pred", str(out), "--json", str(scores)], check=True, capture_output=True)
    result = json.loads(scores.read_text())
    assert result["overall"]["rate"] >= 0.13
    assert result["precision"] >= 0.85
    assert result["overall"]["err3d_median_mm"] <= 18.0

"""Calibrations on disk: what is written comes back, what is wrong is named."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from robot.calibration_file import load_rig, save_rig
from robot.errors import ConfigError, FileError
from tests.robot.vision.spheres import small_rig

RIG = replace(small_rig(tilted=True), world_from_left=np.diag([1.0, -1.0, -1.0, 1.0]))


def test_a_rig_comes_back_as_it_was_saved(tmp_path: Path) -> None:
    save_rig(tmp_path / "rig.json", RIG)
    back = load_rig(tmp_path / "rig.json")
    assert back.image_size == RIG.image_size
    for key in ("K_left", "K_right", "dist_left", "dist_right", "R", "t_m", "world_from_left"):
        assert getattr(back, key) == pytest.approx(getattr(RIG, key), abs=1e-12), key


def test_a_rig_without_world_has_none_afterwards(tmp_path: Path) -> None:
    save_rig(tmp_path / "rig.json", small_rig(tilted=False))
    assert load_rig(tmp_path / "rig.json").world_from_left is None


def edited(tmp_path: Path, edit: Callable[[dict[str, Any]], object]) -> Path:
    path = tmp_path / "rig.json"
    save_rig(path, RIG)
    content = json.loads(path.read_text())
    edit(content)
    path.write_text(json.dumps(content))
    return path


def test_four_distortion_terms_are_five_with_a_zero(tmp_path: Path) -> None:
    rig = load_rig(edited(tmp_path, lambda content: content.update(dist_left=[-0.1, 0.02, 0.0, 0.001])))
    assert rig.dist_left.tolist() == [-0.1, 0.02, 0.0, 0.001, 0.0]


def test_a_rotation_of_six_digits_is_made_exact(tmp_path: Path) -> None:
    rig = load_rig(edited(tmp_path, lambda content: content.update(R=np.round(RIG.R, 6).tolist())))
    assert np.abs(rig.R @ rig.R.T - np.eye(3)).max() < 1e-14


def test_descriptive_keys_are_read_over(tmp_path: Path) -> None:
    load_rig(edited(tmp_path, lambda content: content.update(rig="real", P_left=[], baseline_m=0.06)))


@pytest.mark.parametrize(
    ("edit", "message"),
    [
        (lambda c: c.pop("K_right"), "'K_right' is missing"),
        (lambda c: c.update(t_mm=[1, 2, 3]), "unknown key 't_mm'; did you mean 't_m'"),
        (lambda c: c["t_m"].__setitem__(0, float("nan")), "'t_m' must be finite"),
        (lambda c: c.update(t_m=[-60.0, 0.0, 0.0]), r"metres, not millimetres\), found 60 m"),
        (lambda c: c.update(t_m=[0.06, 0.0, 0.0]), "left and right swapped"),
        (lambda c: c.update(K_left=[[1, 2], [3, 4]]), r"'K_left' must have shape \(3, 3\), found \(2, 2\)"),
        (lambda c: c.update(K_left="wide"), "'K_left' must be numbers"),
        (lambda c: c["K_left"][0].__setitem__(0, 0.5), "focal lengths of 0.2 to 20 image widths"),
        (lambda c: c["K_left"][0].__setitem__(2, 900.0), "principal point in the image"),
        (lambda c: c["K_left"][2].__setitem__(2, 2.0), r"\[0, 0, 1\]"),
        (lambda c: c.update(dist_left=[0.1] * 8), r"'dist_left' must have shape \(5,\), found \(8,\)"),
        (lambda c: c["R"][0].__setitem__(0, 0.5), "'R' must be a rotation"),
        (lambda c: c.update(R=np.diag([1, 1, -1]).tolist()), "'R' must be a rotation"),
        (lambda c: c.update(image_size=[640.5, 480]), "'image_size' must be"),
        (lambda c: c["world_from_left"][3].__setitem__(0, 1.0), "'world_from_left' must end with the row"),
    ],
)
def test_a_wrong_value_is_named_with_its_key_and_a_remedy(
    tmp_path: Path, edit: Callable[[dict[str, Any]], object], message: str
) -> None:
    path = edited(tmp_path, edit)
    with pytest.raises(ConfigError, match=message) as raised:
        load_rig(path)
    assert str(raised.value).startswith(f"{path}: ")
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize("content", [b"{", b"[1, 2]", b"\xff\xfe\x00"])
def test_a_file_that_is_no_json_object_is_refused(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "rig.json").write_bytes(content)
    with pytest.raises(ConfigError, match=r"rig\.json: .*calibrate again"):
        load_rig(tmp_path / "rig.json")


def test_a_missing_calibration_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"rig\.json: the calibration cannot be read"):
        load_rig(tmp_path / "rig.json")


def test_a_rig_that_could_not_be_read_again_is_not_written(tmp_path: Path) -> None:
    swapped = replace(RIG, t_m=-RIG.t_m)
    with pytest.raises(ConfigError, match=r"not written: .* swapped"):
        save_rig(tmp_path / "rig.json", swapped)
    assert list(tmp_path.iterdir()) == []


def test_saving_into_a_missing_folder_is_refused(tmp_path: Path) -> None:
    with pytest.raises(FileError, match="cannot be written"):
        save_rig(tmp_path / "nowhere" / "rig.json", RIG)

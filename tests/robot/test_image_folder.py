"""Images on disk: what is a pair, what is none, what cannot be read."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from robot.errors import FileError
from robot.image_folder import find_images, find_pairs, read_grey_image, read_image


def picture() -> np.ndarray:
    rng = np.random.default_rng(1)
    return np.asarray(cv2.resize(rng.integers(0, 256, (6, 8, 3), dtype=np.uint8), (64, 48)), dtype=np.uint8)


def write(path: Path) -> Path:
    cv2.imwrite(str(path), picture())
    return path


def test_pairs_come_by_scene_id_with_the_place_of_their_sidecar(tmp_path: Path) -> None:
    for name in ("b_left.png", "b_right.jpg", "a_1_left.JPG", "a_1_right.JPG", "notes_left.txt", "other.png"):
        (tmp_path / name).touch()
    pairs = find_pairs(tmp_path)
    assert [(pair.scene_id, pair.left.name, pair.right.name) for pair in pairs] == [
        ("a_1", "a_1_left.JPG", "a_1_right.JPG"),
        ("b", "b_left.png", "b_right.jpg"),
    ]
    assert pairs[0].sidecar == tmp_path / "a_1.json"


def test_masks_depth_images_and_hidden_files_are_no_photos(tmp_path: Path) -> None:
    for name in ("s_left.png", "s_right.png", "s_mask_left.png", "s_depth_left.png", "s_left_depth.png", ".s_left.png"):
        (tmp_path / name).touch()
    assert [pair.scene_id for pair in find_pairs(tmp_path)] == ["s"]
    assert [path.name for path in find_images(tmp_path)] == ["s_left.png", "s_right.png"]


@pytest.mark.parametrize(("present", "missing"), [("s_left.png", "s_right"), ("s_right.png", "s_left")])
def test_a_missing_partner_is_named(tmp_path: Path, present: str, missing: str) -> None:
    (tmp_path / present).touch()
    with pytest.raises(FileError, match=rf"{present}: its partner {missing}\.png is missing; add it"):
        find_pairs(tmp_path)


def test_two_files_for_one_side_are_refused(tmp_path: Path) -> None:
    for name in ("s_left.png", "s_left.jpg", "s_right.png"):
        (tmp_path / name).touch()
    with pytest.raises(FileError, match=r"s_left\.png: there is also s_left\.jpg"):
        find_pairs(tmp_path)


def test_a_folder_without_images_or_no_folder_at_all_is_named(tmp_path: Path) -> None:
    with pytest.raises(FileError, match="no pairs named"):
        find_pairs(tmp_path)
    with pytest.raises(FileError, match="no images"):
        find_images(tmp_path)
    with pytest.raises(FileError, match="nowhere: cannot be read as a folder"):
        find_images(tmp_path / "nowhere")


def test_a_png_is_read_as_it_was_stored(tmp_path: Path) -> None:
    assert np.array_equal(read_image(write(tmp_path / "a.png")), picture())
    assert read_grey_image(tmp_path / "a.png").shape == (48, 64)


def test_a_jpeg_with_a_turning_tag_keeps_the_stored_rows(tmp_path: Path) -> None:
    data = write(tmp_path / "a.jpg").read_bytes()
    orientation_6 = b"Exif\0\0MM\0*\0\0\0\x08\0\x01\x01\x12\0\x03\0\0\0\x01\0\x06\0\0\0\0\0\0"
    segment = b"\xff\xe1" + (len(orientation_6) + 2).to_bytes(2, "big") + orientation_6
    (tmp_path / "turned.jpg").write_bytes(data[:2] + segment + data[2:])
    assert read_image(tmp_path / "turned.jpg").shape == (48, 64, 3)


@pytest.mark.parametrize("suffix", ["jpg", "png"])
def test_a_cut_off_image_is_refused_instead_of_half_grey(tmp_path: Path, suffix: str) -> None:
    path = write(tmp_path / f"a.{suffix}")
    path.write_bytes(path.read_bytes()[:-200])
    with pytest.raises(FileError, match="cut off after"):
        read_image(path)


@pytest.mark.parametrize("content", [b"", b"not an image", bytes(5000)])
def test_a_file_that_is_no_image_is_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "a.jpg"
    path.write_bytes(content)
    with pytest.raises(FileError, match=r"a\.jpg: cannot be decoded"):
        read_image(path)


def test_a_missing_image_is_named(tmp_path: Path) -> None:
    with pytest.raises(FileError, match=r"gone\.png: cannot be read"):
        read_image(tmp_path / "gone.png")

"""Files that appear whole or not at all."""

from __future__ import annotations

import os
import resource
from collections.abc import Iterator
from pathlib import Path

import pytest

from robot.atomic_file import atomic_file
from robot.errors import FileError


def test_the_file_appears_with_its_whole_content_at_the_end(tmp_path: Path) -> None:
    path = tmp_path / "out.txt"
    with atomic_file(path) as stream:
        stream.write(b"one\n")
        assert not path.exists()
        stream.write(b"two\n")
    assert path.read_bytes() == b"one\ntwo\n"
    assert os.listdir(tmp_path) == ["out.txt"]


def test_the_former_content_stays_when_the_block_fails(tmp_path: Path) -> None:
    path = tmp_path / "out.txt"
    path.write_bytes(b"before")
    with pytest.raises(ZeroDivisionError), atomic_file(path) as stream:
        stream.write(b"half" * (1 // 0))
    assert path.read_bytes() == b"before"
    assert os.listdir(tmp_path) == ["out.txt"]


def test_the_file_has_the_rights_of_an_ordinary_new_file(tmp_path: Path) -> None:
    (tmp_path / "plain").touch()
    with atomic_file(tmp_path / "out"):
        pass
    assert (tmp_path / "out").stat().st_mode == (tmp_path / "plain").stat().st_mode


def test_a_folder_in_the_files_place_is_refused(tmp_path: Path) -> None:
    with pytest.raises(FileError, match="is a folder"), atomic_file(tmp_path):
        pass


@pytest.fixture
def room_for_100_bytes() -> Iterator[None]:
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100, hard))
    yield
    resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


@pytest.mark.usefixtures("room_for_100_bytes")
def test_a_disk_without_room_is_named_and_leaves_nothing(tmp_path: Path) -> None:
    with pytest.raises(FileError, match=r"out: cannot be written .*has room"), atomic_file(tmp_path / "out") as stream:
        stream.write(bytes(101))
    assert os.listdir(tmp_path) == []

"""Recorded pairs: their pace, their end, and recordings that are none."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from drivers.camera.files import FilesCamera, FilesSettings
from drivers.camera.values import Image
from drivers.errors import DeviceError, DeviceFault, DeviceLost, DeviceMissing, WrongDevice
from tests.drivers.camera.rig import run

SIZE = (64, 48)


def view(number: int, side: int) -> Image:
    return np.full((SIZE[1], SIZE[0], 3), 20 * number + 5 * side + 10, dtype=np.uint8)


def folder_of(path: Path, pairs: int) -> Path:
    for number in range(pairs):
        for side, name in enumerate(("left", "right")):
            cv2.imwrite(str(path / f"scene_{number}_{name}.png"), view(number, side))
    return path


def film_of(path: Path, pairs: int) -> Path:
    writer = cv2.VideoWriter(
        str(path / "film.avi"), cv2.CAP_OPENCV_MJPEG, cv2.VideoWriter.fourcc(*"MJPG"), 15.0, (2 * SIZE[0], SIZE[1])
    )
    for number in range(pairs):
        writer.write(np.hstack((view(number, 0), view(number, 1))))
    writer.release()
    return path / "film.avi"


def play(source: Path, test: Callable[[FilesCamera], Awaitable[None]], loops: bool = True) -> None:
    async def main() -> None:
        settings = FilesSettings(source, SIZE, 0.004, rate_hz=10.0, loops=loops)
        device = FilesCamera(settings, asyncio.get_running_loop().time)
        await device.open()
        await test(device)
        await device.close()

    run(main, leaps=True)


@pytest.mark.parametrize("record", [folder_of, film_of])
def test_pairs_come_in_order_at_their_pace_and_begin_again(record: Callable[[Path, int], Path], tmp_path: Path) -> None:
    async def test(device: FilesCamera) -> None:
        frames = [await device.capture() for _ in range(7)]
        for frame in frames:
            number = (frame.sequence - 1) % 3
            assert abs(int(frame.left.mean()) - int(view(number, 0).mean())) <= 1
            assert abs(int(frame.right.mean()) - int(view(number, 1).mean())) <= 1
        steps_s = np.diff([frame.stamp_s for frame in frames])
        sequences = np.diff([frame.sequence for frame in frames])
        assert steps_s == pytest.approx(0.1 * sequences)

    play(record(tmp_path, 3), test)


@pytest.mark.parametrize("record", [folder_of, film_of])
def test_the_recording_runs_on_while_nobody_looks(record: Callable[[Path, int], Path], tmp_path: Path) -> None:
    async def test(device: FilesCamera) -> None:
        first = await device.capture()
        await asyncio.sleep(1.05)
        later = await device.capture()
        assert later.sequence - first.sequence == pytest.approx(10.0 * (later.stamp_s - first.stamp_s))

    play(record(tmp_path, 4), test)


def test_a_recording_that_does_not_loop_is_lost_at_its_end(tmp_path: Path) -> None:
    async def test(device: FilesCamera) -> None:
        seen: list[int] = []

        async def to_the_end() -> None:
            while True:
                seen.append((await device.capture()).sequence)

        with pytest.raises(DeviceLost, match="after the last of 3"):
            await to_the_end()
        assert 1 <= seen[-1] <= 3

    play(folder_of(tmp_path, 3), test, loops=False)


def refused(source: Path) -> DeviceError:
    async def nothing(device: FilesCamera) -> None:
        """It must not come so far."""

    with pytest.raises(DeviceError) as caught:
        play(source, nothing)
    return caught.value


def test_a_recording_that_is_not_there_is_missing(tmp_path: Path) -> None:
    assert isinstance(refused(tmp_path / "none"), DeviceMissing)


def test_a_folder_without_pairs_and_a_file_that_is_no_video_are_the_wrong_device(tmp_path: Path) -> None:
    assert isinstance(refused(tmp_path), WrongDevice)
    (tmp_path / "notes.txt").write_text("no video")
    assert isinstance(refused(tmp_path / "notes.txt"), WrongDevice)


def test_a_view_without_its_partner_is_named(tmp_path: Path) -> None:
    (folder_of(tmp_path, 2) / "scene_1_right.png").unlink()
    error = refused(tmp_path)
    assert isinstance(error, DeviceFault)
    assert "scene_1" in error.expected


@pytest.mark.parametrize("record", [folder_of, film_of])
def test_a_recording_of_another_size_is_told_with_both_sizes(
    record: Callable[[Path, int], Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    source = record(tmp_path, 2)
    monkeypatch.setattr("tests.drivers.camera.test_files.SIZE", (80, 48))
    error = refused(source)
    assert isinstance(error, WrongDevice)
    assert "80x48" in error.expected or "160x48" in error.expected
    assert "64x48" in error.found or "128x48" in error.found


def test_masks_beside_the_pairs_are_no_views(tmp_path: Path) -> None:
    source = folder_of(tmp_path, 1)
    cv2.imwrite(str(source / "scene_0_mask_left.png"), view(9, 0))

    async def test(device: FilesCamera) -> None:
        assert [(await device.capture()).left.mean() for _ in range(2)] == [view(0, 0).mean()] * 2

    play(source, test)

"""Recorded stereo pairs, played at their pace: a folder of left and right images, or a side-by-side video."""

from __future__ import annotations

import asyncio
import math
import re
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from drivers.camera.values import Image, StereoFrame
from drivers.errors import DeviceFault, DeviceLost, DeviceMissing, DeviceRefused, WrongDevice

_KINDS = frozenset({".bmp", ".jpeg", ".jpg", ".png", ".tif", ".tiff"})
_SIDE = re.compile(r"(?P<id>.+)_(?P<side>left|right)", re.IGNORECASE)
_NO_PICTURE = re.compile(r"(^|_)(mask|depth|disparity)(_|$)", re.IGNORECASE)


@dataclass(frozen=True, slots=True)
class FilesSettings:
    """``source``: a folder of ``<id>_left.*`` and ``<id>_right.*`` images, in the order of their ids, or a video file.

    ``image_size`` (width, height) of each view. ``exposure_s`` and ``gain`` are those of the recording. ``loops``:
    begin again after the last pair; else the camera is lost there.
    """

    source: Path
    image_size: tuple[int, int]
    exposure_s: float
    gain: float = 1.0
    rate_hz: float = 15.0
    loops: bool = True


class FilesCamera:
    """Implements ``drivers.camera.interface.StereoCamera``; ``clock`` gives loop time.

    The recording runs from ``open`` on, whether or not anybody looks; ``sequence`` counts its pairs from 1, over the
    end. Its exposure is fixed: ``set_exposure`` to another raises ``DeviceRefused``.
    """

    def __init__(self, settings: FilesSettings, clock: Callable[[], float]) -> None:
        self.settings = settings
        self._clock = clock
        self._recording: _Recording | None = None
        self._reading = asyncio.Lock()
        self._began_s = 0.0

    @property
    def image_size(self) -> tuple[int, int]:
        return self.settings.image_size

    async def open(self) -> None:
        settings = self.settings
        self._recording = await asyncio.to_thread(_recording, settings.source, settings.image_size)
        self._began_s = self._clock()

    async def close(self) -> None:
        if self._recording is not None:
            self._recording.close()
            self._recording = None

    async def capture(self) -> StereoFrame:
        settings, recording = self.settings, self._required()
        number = math.floor((self._clock() - self._began_s) * settings.rate_hz + 1e-6) + 1
        if number > len(recording) and not settings.loops:
            raise DeviceLost(
                "camera", f"a pair after the last of {len(recording)}", f"the end of {settings.source}",
                "let the recording loop, or record more",
            )  # fmt: skip
        begin_s = self._began_s + number / settings.rate_hz
        await asyncio.sleep(max(0.0, begin_s + settings.exposure_s - self._clock()))
        async with self._reading:
            left, right = await asyncio.to_thread(recording.pair, (number - 1) % len(recording))
        self._required()
        return StereoFrame(begin_s + 0.5 * settings.exposure_s, number, left, right, settings.exposure_s, settings.gain)

    async def set_exposure(self, exposure_s: float, gain: float) -> None:
        if not (exposure_s > 0.0 and gain >= 1.0):
            raise ValueError(f"exposure: expected above 0 s and a gain of 1 or more, found {exposure_s:g} s, {gain:g}")
        self._required()
        settings = self.settings
        if (exposure_s, gain) != (settings.exposure_s, settings.gain):
            raise DeviceRefused(
                "camera", f"the exposure of the recording ({settings.exposure_s:g} s, gain {settings.gain:g})",
                f"{exposure_s:g} s, gain {gain:g}", "a recording cannot be exposed anew",
            )  # fmt: skip

    def _required(self) -> _Recording:
        if self._recording is None:
            raise DeviceLost("camera", "an open connection", "a closed one", "open the device first")
        return self._recording


class _Recording(ABC):
    """Pairs by number. Reading one blocks; ``DeviceFault`` when it cannot be read."""

    @abstractmethod
    def __len__(self) -> int: ...

    @abstractmethod
    def pair(self, number: int) -> tuple[Image, Image]: ...

    @abstractmethod
    def close(self) -> None: ...


class _Folder(_Recording):
    def __init__(self, pairs: list[tuple[Path, Path]], size: tuple[int, int]) -> None:
        self._pairs, self._size = pairs, size
        self.pair(0)

    def __len__(self) -> int:
        return len(self._pairs)

    def pair(self, number: int) -> tuple[Image, Image]:
        left, right = (_read(path, self._size) for path in self._pairs[number])
        return left, right

    def close(self) -> None:
        """No file stays open between two pairs."""


class _Film(_Recording):
    def __init__(self, path: Path, size: tuple[int, int]) -> None:
        self._path, self._size = path, size
        self._capture = cv2.VideoCapture(str(path))
        if not self._capture.isOpened():
            self.close()
            raise WrongDevice("camera", f"{path} to be a video", "something else", "name a side-by-side recording")
        found = round(self._capture.get(cv2.CAP_PROP_FRAME_WIDTH)), round(self._capture.get(cv2.CAP_PROP_FRAME_HEIGHT))
        if found != (2 * size[0], size[1]):
            self.close()
            raise _other_size(path, (2 * size[0], size[1]), found)
        self._length = round(self._capture.get(cv2.CAP_PROP_FRAME_COUNT))
        self._next = 0
        self.pair(0)

    def __len__(self) -> int:
        return self._length

    def pair(self, number: int) -> tuple[Image, Image]:
        if number < self._next:
            self._capture.set(cv2.CAP_PROP_POS_FRAMES, 0)
            self._next = 0
        while self._next < number and self._capture.grab():
            self._next += 1
        took, whole = self._capture.read()
        if not took:
            raise DeviceFault("camera", f"pair {number + 1} of {self._path}", "none", "record it again")
        self._next += 1
        width = self._size[0]
        picture: Image = np.asarray(whole, dtype=np.uint8)
        return np.ascontiguousarray(picture[:, :width]), np.ascontiguousarray(picture[:, width:])

    def close(self) -> None:
        self._capture.release()


def _recording(source: Path, size: tuple[int, int]) -> _Recording:
    if source.is_file():
        return _Film(source, size)
    if not source.is_dir():
        raise DeviceMissing("camera", f"a recording at {source}", "nothing there", "name a folder or a video file")
    sides: dict[str, dict[str, Path]] = {"left": {}, "right": {}}
    for path in sorted(source.iterdir()):
        match = _SIDE.fullmatch(path.stem)
        if match is not None and path.suffix.lower() in _KINDS and not _NO_PICTURE.search(path.stem):
            sides[match["side"].lower()][match["id"]] = path
    if not sides["left"]:
        raise WrongDevice(
            "camera", f"pairs <id>_left.* and <id>_right.* in {source}", "none", "name the folder of the recording"
        )
    if lonely := sorted(sides["left"].keys() ^ sides["right"].keys()):
        raise DeviceFault(
            "camera", f"both views of {lonely[0]} in {source}", "one", "complete the recording, or take the view away"
        )
    return _Folder([(path, sides["right"][name]) for name, path in sides["left"].items()], size)


def _read(path: Path, size: tuple[int, int]) -> Image:
    picture = cv2.imread(str(path), cv2.IMREAD_COLOR)
    if picture is None:
        raise DeviceFault("camera", f"{path} to be an image", "a garbled one", "record it again")
    if picture.shape[:2] != (size[1], size[0]):
        raise _other_size(path, size, (picture.shape[1], picture.shape[0]))
    return np.asarray(picture, dtype=np.uint8)


def _other_size(path: Path, expected: tuple[int, int], found: tuple[int, int]) -> WrongDevice:
    return WrongDevice(
        "camera", f"pictures of {expected[0]}x{expected[1]}", f"{found[0]}x{found[1]} in {path}",
        "correct image_size_px, or name the right recording",
    )  # fmt: skip

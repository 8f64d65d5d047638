"""Keeps the annotated frame of every stop."""

from __future__ import annotations

from pathlib import Path

import cv2

from robot.annotate import draw_fruits
from robot.atomic_file import atomic_file
from robot.clock import work
from robot.errors import FileError
from robot.events import Bus
from robot.mission import FrameSeen
from robot.mission.detect import frame_file

WRITE_S = 0.05


class FrameRecorder:
    """Writes ``folder/stop_NNN.jpg`` for each frame that was looked at."""

    def __init__(self, bus: Bus, folder: Path) -> None:
        self._folder = folder
        self._frames = bus.subscribe(FrameSeen)

    async def run(self) -> None:
        async for seen in self._frames:
            await work(lambda seen=seen: self._write(seen), WRITE_S)  # type: ignore[misc]

    def write_rest(self) -> None:
        """What is still unwritten when the run ends."""
        for seen in self._frames.drain():
            self._write(seen)

    def _write(self, seen: FrameSeen) -> None:
        path = self._folder / frame_file(seen.stop)
        picture = draw_fruits(seen.frame.left, seen.fruits, seen.target_ids)
        done, data = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, 88])
        if not done:
            raise FileError(f"{path}: the frame cannot be encoded as JPEG; check the OpenCV installation")
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
            with atomic_file(path) as stream:
                stream.write(data.tobytes())
        except OSError as error:
            raise FileError(f"{self._folder}: cannot be created ({error.strerror}); check place and space") from error

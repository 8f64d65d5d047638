"""Every byte that went over a port, with its moment and direction, in a file that can be read and replayed.

JSON lines: first ``{"device", "protocol", "path", "baud"}``, then ``{"t", "dir", "hex"}`` with ``t`` in seconds of the
run's clock and ``dir`` "out" (from the host) or "in" (to the host). A torn last line is passed over.
"""

from __future__ import annotations

import json
import logging
import threading
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from io import BufferedWriter
from pathlib import Path
from typing import Literal

Direction = Literal["out", "in"]

FULL = b'{"note":"the trace is full"}\n'  # the last line of a trace that has grown too long
_log = logging.getLogger(__name__)

LONGEST_BYTES = 256 * 1024 * 1024


@dataclass(frozen=True, slots=True)
class TraceHead:
    """Whose bytes these are."""

    device: str
    protocol: str
    path: str
    baud: int


@dataclass(frozen=True, slots=True)
class Chunk:
    """Bytes that were written or read together at ``stamp_s``."""

    stamp_s: float
    direction: Direction
    data: bytes


class ByteTrace:
    """Appends chunks to a file; ends with a note when the file has grown to ``longest_bytes``.

    A disk that takes no more ends the trace with a warning in the log: the device goes on.
    """

    def __init__(self, path: Path, head: TraceHead, longest_bytes: int = LONGEST_BYTES) -> None:
        self._path = path
        self._file: BufferedWriter | None = path.open("wb")
        self._left = longest_bytes
        self._mutex = threading.Lock()
        self._write({"device": head.device, "protocol": head.protocol, "path": head.path, "baud": head.baud})

    def keep(self, stamp_s: float, direction: Direction, data: bytes) -> None:
        with self._mutex:
            try:
                self._write({"t": round(stamp_s, 6), "dir": direction, "hex": data.hex()})
            except OSError as error:
                _log.warning("%s: the byte trace ends here: %s", self._path, error.strerror or error)
                self._end()

    def close(self) -> None:
        with self._mutex:
            self._end()

    def _end(self) -> None:
        file, self._file = self._file, None
        if file is not None:
            with suppress(OSError):  # what is still held back finds no room either, which is told already
                file.close()

    def _write(self, line: dict[str, object]) -> None:
        if self._file is None:
            return
        data = json.dumps(line, separators=(",", ":")).encode() + b"\n"
        self._left -= len(data)
        if self._left < 0:
            self._file.write(FULL)
            self._end()
            return
        self._file.write(data)
        self._file.flush()


def read_trace(path: Path) -> tuple[TraceHead, Iterator[Chunk]]:
    """The head and the chunks of a trace. ``ValueError`` when the file is not one, ``OSError`` when unreadable."""
    with path.open("rb") as stream:
        try:
            head = TraceHead(**json.loads(stream.readline()))
        except (ValueError, TypeError) as error:
            raise ValueError(
                f"{path}: expected a byte trace, found another kind of file; give a file that a run wrote with --trace"
            ) from error
    return head, _chunks(path)


def _chunks(path: Path) -> Iterator[Chunk]:
    with path.open("rb") as stream:
        next(stream)
        for number, text in enumerate(stream, start=2):
            if not text.endswith(b"\n"):
                return
            try:
                line = json.loads(text)
                if "note" in line:
                    return
                yield Chunk(float(line["t"]), _direction(line["dir"]), bytes.fromhex(line["hex"]))
            except (ValueError, KeyError, TypeError) as error:
                raise ValueError(f"{path}: line {number} is not of a byte trace; the file was changed") from error


def _direction(word: object) -> Direction:
    if word not in ("out", "in"):
        raise ValueError(word)
    return word

"""The truth file: one JSON line a command and physical event, on disk before the machine answers.

Kinds of line: ``world`` (a process starts), ``command``, ``event``, ``state`` (a snapshot) and ``view`` (a frame).
Every ``t`` is seconds in the clock of the process whose ``world`` line stands before.
"""

from __future__ import annotations

import fcntl
import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

FORMAT = 1


class TruthLog:
    """Appends lines, unbuffered; ``path`` None keeps nothing. One process at a time may hold the file.

    Raises ``BlockingIOError`` when another process writes to it, ``OSError`` when it cannot be written.
    """

    def __init__(self, path: Path | None) -> None:
        self._fd: int | None = None
        if path is not None:
            self._fd = os.open(path, os.O_RDWR | os.O_CREAT | os.O_APPEND | os.O_CLOEXEC, 0o644)
            try:
                fcntl.flock(self._fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError as error:
                self.close()
                raise BlockingIOError(
                    f"truth file {path}: expected no other writer, found one; stop the other run or name another file"
                ) from error
            self._mend()

    @property
    def keeps(self) -> bool:
        """Whether a line that is appended goes anywhere."""
        return self._fd is not None

    def append(self, line: Mapping[str, Any]) -> None:
        if self._fd is None:
            return
        data = json.dumps(line, separators=(",", ":"), allow_nan=False).encode() + b"\n"
        while data:
            data = data[os.write(self._fd, data) :]

    def close(self) -> None:
        if self._fd is not None:
            os.close(self._fd)
            self._fd = None

    def _mend(self) -> None:
        """Cut off a last line that a dying process left torn."""
        assert self._fd is not None
        size = os.fstat(self._fd).st_size
        end = size
        while end > 0:
            start = max(0, end - 65536)
            block = os.pread(self._fd, end - start, start)
            if (newline := block.rfind(b"\n")) >= 0:
                end = start + newline + 1
                break
            end = start
        if end != size:
            os.ftruncate(self._fd, end)


class TruthList(TruthLog):
    """Keeps the lines in memory."""

    def __init__(self) -> None:
        super().__init__(None)
        self.lines: list[dict[str, Any]] = []

    @property
    def keeps(self) -> bool:
        return True

    def append(self, line: Mapping[str, Any]) -> None:
        self.lines.append(dict(line))

"""The file of the control socket: made where nobody answers yet, and gone when we go."""

from __future__ import annotations

import errno
import os
import socket
import stat
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Self

from robot.client import answers
from robot.errors import BusyError, ConfigError, FileError

LONGEST_PATH_BYTES = 107  # sun_path of Linux, less its closing zero
MODE = 0o660
BACKLOG = 64


class ControlSocket:
    """A listening socket. ``open`` takes the place of a dead robot's file; leaving the context removes it."""

    def __init__(self, path: Path, listening: socket.socket) -> None:
        self.path = path
        self.listening = listening
        self._inode = path.stat().st_ino

    @classmethod
    def open(cls, path: Path) -> Self:
        """``BusyError`` while another robot answers there, ``FileError`` when something else is in the way,
        ``ConfigError`` for a path that no socket can have."""
        length = len(os.fsencode(path))
        if length > LONGEST_PATH_BYTES:
            raise ConfigError(
                f"{path}: a socket's path has at most {LONGEST_PATH_BYTES} bytes, this one {length}; "
                "choose a shorter run directory"
            )
        try:
            _make_way(path)
            listening = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
            try:
                listening.bind(os.fspath(path))
                path.chmod(MODE)
                listening.listen(BACKLOG)
                listening.setblocking(False)
                return cls(path, listening)
            except BaseException:
                listening.close()
                raise
        except OSError as error:
            if error.errno == errno.EADDRINUSE:
                raise BusyError(f"{path}: another robot is coming up here; wait for it, or end it") from error
            raise FileError(
                f"{path}: the control socket cannot be made ({error.strerror}); choose another run directory"
            ) from error

    def close(self) -> None:
        self.listening.close()
        with suppress(OSError):
            if self.path.stat().st_ino == self._inode:  # not one that somebody put there since
                self.path.unlink()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def _make_way(path: Path) -> None:
    try:
        found = path.lstat()
    except FileNotFoundError:
        return
    if not stat.S_ISSOCK(found.st_mode):
        raise FileError(f"{path}: expected the place of the control socket, found another kind of file; move it away")
    if answers(path):
        raise BusyError(f"{path}: a robot answers here already; end that one, or choose another run directory")
    path.unlink()

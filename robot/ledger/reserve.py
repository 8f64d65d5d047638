"""Room on the disk that is kept for the ledger's last rows."""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path

RESERVE_BYTES = 16 * 1024 * 1024


class Reserve:
    """A file of ``size_bytes`` beside the ledger that stands in for rows which must not be lost.

    As long as it is held, a disk that fills up still takes the outcome of a shot: ``give_up`` makes room for it.
    """

    def __init__(self, ledger: Path, size_bytes: int = RESERVE_BYTES) -> None:
        self._path = ledger.with_name(ledger.name + ".reserve")
        self._size_bytes = size_bytes
        self.problem = ""
        self.held = False

    def hold(self) -> bool:
        """Take the room, unless it is held already. False, and ``problem`` says why, when the disk has it not."""
        if self.held:
            return True
        try:
            self._take()
        except OSError as error:
            self.give_up()
            self.problem = (
                f"{self._path}: {self._size_bytes} bytes cannot be kept free for the last rows ({error.strerror}); "
                "free space on the disk; no ledger, no spray"
            )
            return False
        self.problem = ""
        self.held = True
        return True

    def give_up(self) -> bool:
        """Leave the room to the ledger's rows; False when none was held."""
        was_held, self.held = self.held, False
        with suppress(OSError):  # a disk that is gone or read-only: there is no room to give
            self._path.unlink(missing_ok=True)
        return was_held

    def _take(self) -> None:
        if self._size_bytes == 0:
            return
        descriptor = os.open(self._path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
        try:
            os.posix_fallocate(descriptor, 0, self._size_bytes)
        finally:
            os.close(descriptor)

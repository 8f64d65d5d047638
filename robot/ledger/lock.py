"""One process a ledger: an advisory lock that ends with the process, and a PID to name its holder."""

from __future__ import annotations

import fcntl
import os
from pathlib import Path

from robot.errors import BusyError, FileError


class LedgerLock:
    """Holds ``<ledger>.lock`` exclusively from construction to ``release``.

    ``BusyError`` names the process that holds it; ``FileError`` when the lock file cannot be written.
    """

    def __init__(self, ledger: Path) -> None:
        self._path = ledger.with_name(ledger.name + ".lock")
        try:
            self._descriptor = os.open(self._path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
        except OSError as error:
            raise FileError(
                f"{self._path}: cannot be created ({error.strerror}); choose a folder that exists and can be written"
            ) from error
        try:
            self._acquire(ledger)
        except BaseException:
            os.close(self._descriptor)
            raise

    def release(self) -> None:
        """Let the next process in; again does nothing. The file stays: removing it would let two processes lock two."""
        descriptor, self._descriptor = self._descriptor, -1
        if descriptor >= 0:
            os.close(descriptor)

    def _acquire(self, ledger: Path) -> None:
        try:
            fcntl.flock(self._descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            holder = os.pread(self._descriptor, 32, 0).decode("ascii", "replace").strip() or "unknown"
            raise BusyError(
                f"{ledger}: in use by process {holder}; stop that process (kill {holder}) or choose another ledger"
            ) from None
        try:
            os.ftruncate(self._descriptor, 0)
            os.pwrite(self._descriptor, f"{os.getpid()}\n".encode("ascii"), 0)
        except OSError as error:
            raise FileError(f"{self._path}: cannot be written ({error.strerror}); free space on the disk") from error

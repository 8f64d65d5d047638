"""Disks that fill up, stop taking writes, or dawdle: for the tests."""

from __future__ import annotations

import resource
import signal
import sqlite3
import subprocess
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, ClassVar

import pytest


@contextmanager
def tiny_disk(size: str = "1m") -> Iterator[Path]:
    """A file system of that size; the test is skipped where none may be mounted."""
    with tempfile.TemporaryDirectory() as name:
        mounted = subprocess.run(
            ["mount", "-t", "tmpfs", "-o", f"size={size}", "none", name], capture_output=True, check=False
        )
        if mounted.returncode != 0:
            pytest.skip(f"no tiny file system may be mounted here: {mounted.stderr.decode().strip()}")
        try:
            yield Path(name)
        finally:
            subprocess.run(["umount", "-l", name], check=True)


@contextmanager
def file_size_limit(size_bytes: int) -> Iterator[None]:
    """No file of this process may grow beyond it."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    old_handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (size_bytes, hard))
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
        signal.signal(signal.SIGXFSZ, old_handler)


def fill(folder: Path) -> Path:
    """Use up every block of the file system that ``folder`` lies on; unlink what comes back to have them again."""
    stuffing = folder / "stuffing"
    with stuffing.open("wb", buffering=0) as stream:
        for size in (65536, 4096):
            try:
                while True:
                    stream.write(b"\0" * size)
            except OSError:
                pass
    return stuffing


class FailingConnection(sqlite3.Connection):
    """Every write fails with the error whose SQLite name ``failing`` holds, as long as it holds one."""

    failing: ClassVar[str] = ""

    def execute(self, sql: str, *values: Any) -> sqlite3.Cursor:
        if self.failing and sql.startswith("BEGIN"):
            error = sqlite3.OperationalError("the disk says no")
            error.sqlite_errorname = self.failing
            raise error
        return super().execute(sql, *values)


@contextmanager
def failing(name: str) -> Iterator[None]:
    FailingConnection.failing = name
    try:
        yield
    finally:
        FailingConnection.failing = ""

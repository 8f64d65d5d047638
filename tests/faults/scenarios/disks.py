"""A disk that refuses the ledger's writes, with SQLite's own errors."""

from __future__ import annotations

import asyncio
import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any
from unittest.mock import patch


class Disk:
    """``failing`` is SQLite's name of the error with which every intent's row ends; "" while the disk is well."""

    failing = ""


@contextmanager
def failing_disk(refused_s: list[float]) -> Iterator[Disk]:
    """Ledgers opened inside lie on a disk that may be told to fail; ``refused_s`` collects when it first refused."""
    disk, connect = Disk(), sqlite3.connect
    clock = _Clock()

    class Connection(sqlite3.Connection):
        def execute(self, sql: str, *values: Any) -> sqlite3.Cursor:
            if disk.failing and sql.startswith("INSERT INTO intent"):
                refused_s.append(clock.now_s())
                error = sqlite3.OperationalError("the disk says no")
                error.sqlite_errorname = disk.failing
                raise error
            clock.look()
            return super().execute(sql, *values)

    def connected(*where: Any, **how: Any) -> sqlite3.Connection:
        return connect(*where, **how | {"factory": Connection})

    with patch.object(sqlite3, "connect", connected):
        yield disk


class _Clock:
    """The loop's time, also in its worker threads."""

    _loop: asyncio.AbstractEventLoop | None = None

    def look(self) -> None:
        try:
            self._loop = asyncio.get_running_loop()
        except RuntimeError:
            return

    def now_s(self) -> float:
        assert self._loop is not None
        return self._loop.time()

"""Power cuts at every write of a ledger: what would lie on the disk, built from copies of its files.

SQLite syncs the write-ahead log before a transaction counts as done. So a cut leaves the log whole up to the last
transaction that was done, and anything of what was written after it: nothing, a part of a frame, or garbage.
"""

from __future__ import annotations

import sqlite3
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from robot.ledger import Ledger

WAL_HEADER, FRAME_HEADER, PAGE = 32, 24, 4096
FRAME = FRAME_HEADER + PAGE


@dataclass(frozen=True)
class Files:
    """The ledger and its log."""

    base: bytes
    log: bytes

    @classmethod
    def of(cls, path: Path) -> Files:
        log = path.with_name(path.name + "-wal")
        return cls(path.read_bytes(), log.read_bytes() if log.exists() else b"")

    def lay(self, path: Path) -> Path:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(self.base)
        path.with_name(path.name + "-wal").write_bytes(self.log)
        return path


@dataclass(frozen=True)
class Moment:
    """The files after one statement; ``done`` steps of the script had returned, and ``within``: the next had begun."""

    done: int
    files: Files
    within: bool


class Watched(sqlite3.Connection):
    """Hands over after every statement."""

    after: ClassVar[Callable[[], None]] = staticmethod(lambda: None)

    def execute(self, sql: str, *values: Any) -> sqlite3.Cursor:
        cursor = super().execute(sql, *values)
        type(self).after()
        return cursor

    def executemany(self, sql: str, values: Any) -> sqlite3.Cursor:
        cursor = super().executemany(sql, values)
        type(self).after()
        return cursor


def play(path: Path, script: Sequence[Callable[[Ledger], object]], ledger: Ledger) -> tuple[list[Moment], list[Any]]:
    """Every moment of a script, and what the ledger held after each of its steps (``[0]``: before the first)."""
    moments: list[Moment] = []
    held = [contents(ledger)]
    nobody = Watched.after
    for done, step in enumerate(script):
        Watched.after = staticmethod(lambda done=done: moments.append(Moment(done, Files.of(path), True)))
        try:
            step(ledger)
        finally:
            Watched.after = staticmethod(nobody)
        moments.append(Moment(done + 1, Files.of(path), False))
        held.append(contents(ledger))
    return moments, held


def contents(ledger: Ledger) -> dict[str, list[tuple[Any, ...]]]:
    """Every row of every table."""
    names = ledger._connection.execute("SELECT name FROM sqlite_schema WHERE type = 'table' ORDER BY name").fetchall()
    return {name: ledger._connection.execute(f"SELECT * FROM {name} ORDER BY 1, 2").fetchall() for (name,) in names}


def cuts(safe: Files, now: Files) -> Iterator[Files]:
    """What the disk may hold when power goes between ``safe``, which was synced, and ``now``."""
    same = next((n for n, (a, b) in enumerate(zip(safe.log, now.log, strict=False)) if a != b), len(safe.log))
    first = max(0, (same - WAL_HEADER) // FRAME)
    ends = [0] if same < WAL_HEADER else []  # the log begins anew, over the old one
    ends += [WAL_HEADER + FRAME * n for n in range(first, (len(now.log) - WAL_HEADER) // FRAME + 1)]
    for end in ends if now.log != safe.log else ():
        for odd in (0, 1, FRAME_HEADER, FRAME_HEADER + 1777):
            at = min(end + odd, len(now.log))
            yield Files(safe.base, now.log[:at] + safe.log[at:])
            if at > len(safe.log):  # the file grew, its content did not
                kept = max(end, len(safe.log))
                yield Files(safe.base, now.log[:kept] + b"\xa5" * (at - kept))
    yield now
    if now.base != safe.base:  # pages of the log, which is whole by then, on their way into the ledger
        pages = range(0, max(len(now.base), len(safe.base)), PAGE)
        for every in (2, 3):
            mixed = b"".join(
                (now if n % every else safe).base[at : at + PAGE] or now.base[at : at + PAGE]
                for n, at in enumerate(pages)
            )
            yield Files(mixed, now.log)

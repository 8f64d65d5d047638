"""How rows reach the disk: whole or not at all, timed, and with room kept for those that must not be lost."""

from __future__ import annotations

import sqlite3
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import Self, TypeVar

from robot.errors import FileError, SprayerError
from robot.ledger.database import no_room, open_for_writing, readable_errors
from robot.ledger.latency import WriteLatency
from robot.ledger.lock import LedgerLock
from robot.ledger.reader import LedgerReader
from robot.ledger.reserve import RESERVE_BYTES, Reserve

T = TypeVar("T")


class LedgerRuleError(SprayerError):
    """The caller asked the ledger to book what cannot be: a fault of the program, not of the file."""


def wall_clock() -> datetime:
    return datetime.now(UTC)


class LedgerWriter(LedgerReader):
    """One process's hold on a ledger: its lock, its run, its transactions.

    ``latency`` is how long its writes took (``clock``, monotonic seconds); ``problem`` why the last one failed, or why
    no intent is taken, "" when all is well.
    """

    def __init__(
        self, path: Path, connection: sqlite3.Connection, lock: LedgerLock, utc: Callable[[], datetime],
        reserve: Reserve, clock: Callable[[], float],
    ) -> None:  # fmt: skip
        super().__init__(path, connection)
        self._lock, self._reserve = lock, reserve
        self._utc_now, self._clock = utc, clock
        self._run_id: int | None = None
        self._failure = ""
        self.latency = WriteLatency()

    @classmethod
    def open(
        cls, path: Path, utc: Callable[[], datetime] = wall_clock, *, reserve_bytes: int = RESERVE_BYTES,
        clock: Callable[[], float] = time.monotonic, factory: type[sqlite3.Connection] = sqlite3.Connection,
    ) -> Self:  # fmt: skip
        """Open or create the ledger for this process alone; ``BusyError`` names the process that holds it.

        ``reserve_bytes`` stay free on the disk for the last rows; ``factory`` makes the connection.
        """
        lock = LedgerLock(path)
        try:
            reserve = Reserve(path, reserve_bytes)
            ledger = cls(path, open_for_writing(path, factory), lock, utc, reserve, clock)
        except BaseException:
            lock.release()
            raise
        reserve.hold()
        return ledger

    @property
    def problem(self) -> str:
        return self._failure or self._reserve.problem

    def close(self) -> None:
        """The reserve goes first, so that the file can be brought in order on a full disk too."""
        self._reserve.give_up()
        super().close()
        self._lock.release()

    def begin_run(self, boot_id: str, started_utc: datetime) -> int:
        """A new run of the program; all that follows belongs to it."""
        with self._transaction() as db:
            row = db.execute("INSERT INTO run (boot_id, started_utc) VALUES (?, ?)", (boot_id, in_utc(started_utc)))
            self._run_id = new_id(row)
        return self._run_id

    def _run(self) -> int:
        if self._run_id is None:
            raise LedgerRuleError(f"{self.path}: begin_run must come first")
        return self._run_id

    def _now(self) -> str:
        return in_utc(self._utc_now())

    def _demand_reserve(self) -> None:
        """Before anything is opened: its outcome must find room. ``FileError`` when it would not."""
        if not self._reserve.hold():
            raise FileError(self._reserve.problem)

    def _must_be_kept(self, write: Callable[[], T]) -> T:
        """When the disk is full, again with the room of the reserve."""
        try:
            return write()
        except FileError as error:
            if not (no_room(error) and self._reserve.give_up()):
                raise
            return write()

    @contextmanager
    def _transaction(self) -> Iterator[sqlite3.Connection]:
        """All or nothing, durable when left."""
        with self._one_at_a_time:
            began_s = self._clock()
            try:
                with readable_errors(self.path), self._all_or_nothing() as db:
                    yield db
            except FileError as error:
                self._failure = str(error)
                raise
            else:
                self._failure = ""
            finally:
                self.latency = self.latency.with_write(self._clock() - began_s)

    @contextmanager
    def _all_or_nothing(self) -> Iterator[sqlite3.Connection]:
        db = self._connection
        try:
            db.execute("BEGIN IMMEDIATE")
            yield db
            db.execute("COMMIT")
        except BaseException as error:
            if db.in_transaction:
                db.execute("ROLLBACK")
            if isinstance(error, sqlite3.IntegrityError):
                raise LedgerRuleError(f"{self.path}: refused a row: {error}") from error
            raise


def new_id(row: sqlite3.Cursor) -> int:
    """Of the row that was just inserted."""
    assert row.lastrowid is not None
    return row.lastrowid


def in_utc(utc: datetime) -> str:
    if utc.utcoffset() is None:
        raise LedgerRuleError(f"expected a time with its zone, found {utc.isoformat()}; give UTC")
    return utc.astimezone(UTC).isoformat(timespec="milliseconds")

"""Opening the ledger's file, and telling what is wrong with it."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from urllib.parse import quote

from robot.errors import FileError
from robot.ledger.migration import bring_up_to_date, see_as_up_to_date
from robot.ledger.schema import APPLICATION_ID, SCHEMA_VERSION

_BUSY_MS = 5000


def open_for_writing(path: Path, factory: type[sqlite3.Connection] = sqlite3.Connection) -> sqlite3.Connection:
    """Open or create a ledger: WAL, every commit synced to disk. ``FileError`` when it is not usable."""
    with readable_errors(path):
        connection = sqlite3.connect(
            path, check_same_thread=False, isolation_level=None, timeout=_BUSY_MS / 1e3, factory=factory
        )
    try:
        with readable_errors(path):
            _check_kind(connection, path, may_be_empty=True)
            _set_up(connection, path)
    except BaseException:
        connection.close()
        raise
    return connection


def open_for_reading(path: Path) -> sqlite3.Connection:
    """Open an existing ledger read-only, also while a robot writes it. ``FileError`` when it is not usable."""
    if not path.is_file():
        raise FileError(f"{path}: there is no ledger here; give the path of an existing one")
    uri = f"file:{quote(str(path.resolve()))}?mode=ro"
    with readable_errors(path):
        connection = sqlite3.connect(
            uri, uri=True, check_same_thread=False, isolation_level=None, timeout=_BUSY_MS / 1e3
        )
    try:
        with readable_errors(path):
            _check_kind(connection, path, may_be_empty=False)
            see_as_up_to_date(connection, _pragma(connection, "user_version"))
    except BaseException:
        connection.close()
        raise
    return connection


@contextmanager
def readable_errors(path: Path) -> Iterator[None]:
    """Turn SQLite's errors about the file into ``FileError`` with what to do."""
    try:
        yield
    except sqlite3.Error as error:
        raise FileError(f"{path}: {error}; {_remedy(error)}") from error


def no_room(error: FileError) -> bool:
    """Whether the disk may have been full: freeing room is worth another try."""
    return str(getattr(error.__cause__, "sqlite_errorname", "")).startswith(("SQLITE_FULL", "SQLITE_IOERR"))


def _remedy(error: sqlite3.Error) -> str:
    name = getattr(error, "sqlite_errorname", "")
    if name.startswith("SQLITE_FULL"):
        return "free space on the disk; no ledger, no spray"
    if name.startswith("SQLITE_IOERR"):
        return "the disk is full or failing; free space or replace it; no ledger, no spray"
    if name.startswith(("SQLITE_CORRUPT", "SQLITE_NOTADB", "SQLITE_CONSTRAINT")):
        return "not a sound ledger: keep the file for the records, move it away and start a new one"
    if name.startswith(("SQLITE_READONLY", "SQLITE_CANTOPEN", "SQLITE_PERM")):
        return "check that the folder exists and that file and folder can be written"
    if name.startswith(("SQLITE_BUSY", "SQLITE_LOCKED")):
        return "another program keeps the file locked; close it"
    return "check the file and the disk"


def _check_kind(connection: sqlite3.Connection, path: Path, *, may_be_empty: bool) -> None:
    version = _pragma(connection, "user_version")
    tables = int(connection.execute("SELECT count(*) FROM sqlite_schema").fetchone()[0])
    if tables == 0 and version == 0 and may_be_empty:
        return
    if _pragma(connection, "application_id") != APPLICATION_ID:
        raise FileError(f"{path}: a database, but not a ledger of this program; choose another path")
    if version > SCHEMA_VERSION:
        raise FileError(
            f"{path}: written by a newer program (schema {version}, this one knows {SCHEMA_VERSION}); "
            "update the program"
        )
    fault = str(connection.execute("PRAGMA quick_check(1)").fetchone()[0])
    if fault != "ok":
        raise FileError(
            f"{path}: damaged ({fault.splitlines()[-1]}); "
            "keep the file for the records, move it away and start a new one"
        )


def _set_up(connection: sqlite3.Connection, path: Path) -> None:
    mode = str(connection.execute("PRAGMA journal_mode = WAL").fetchone()[0])
    if mode != "wal":
        raise FileError(f"{path}: this file system cannot hold a write-ahead log (mode {mode}); use a local disk")
    connection.execute("PRAGMA synchronous = FULL")
    connection.execute("PRAGMA foreign_keys = ON")
    bring_up_to_date(connection, _pragma(connection, "user_version"))


def _pragma(connection: sqlite3.Connection, name: str) -> int:
    return int(connection.execute(f"PRAGMA {name}").fetchone()[0])

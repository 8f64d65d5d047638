"""What stands in the ledger's file, read beside the robot: only what is committed can be seen here."""

from __future__ import annotations

import sqlite3
from dataclasses import dataclass, field
from pathlib import Path
from urllib.parse import quote

_INTENTS = "SELECT id, task_id, target_id, dose_ml, open_s, pulse_s, full_ml FROM intent WHERE id > ? ORDER BY id"
_RESULTS = "SELECT outcome, booked_ml, open_s FROM result WHERE intent_id = ?"


@dataclass(frozen=True, slots=True)
class IntentSeen:
    """An intent on disk."""

    id: int
    task_id: int
    target_id: int
    dose_ml: float
    open_s: float
    pulse_s: float
    full_ml: float


@dataclass(frozen=True, slots=True)
class ResultSeen:
    """An outcome on disk, with its intent."""

    intent: IntentSeen
    outcome: str
    booked_ml: float
    open_s: float


@dataclass(slots=True, eq=False)
class LedgerView:
    """Keeps up with a ledger by ``refresh``, which returns what was booked since the last time.

    ``open`` are the file's intents without a result, ``intents`` how many of it were seen; ``booked_ml`` is the sum of
    all results of all files that were followed.
    """

    open: dict[int, IntentSeen] = field(default_factory=dict)
    booked_ml: float = 0.0
    intents: int = 0
    last_id: int = 0
    _path: Path | None = None
    _file: sqlite3.Connection | None = None

    def begin(self, path: Path) -> None:
        """A new ledger is begun, there or there soon."""
        self.follow(path)
        self.open.clear()
        self.intents = self.last_id = 0

    def follow(self, path: Path) -> None:
        """The same ledger is to be found there from now on."""
        self.close()
        self._path = path

    def close(self) -> None:
        if self._file is not None:
            self._file.close()
            self._file = None

    @property
    def pending_ml(self) -> float:
        return sum(intent.full_ml for intent in self.open.values())

    @property
    def rows(self) -> int:
        """How many intents the file holds, counted there."""
        return self._count("intent")

    @property
    def tasks(self) -> int:
        return self._count("task")

    def refresh(self) -> list[ResultSeen]:
        file = self._opened()
        if file is None:
            return []
        for row in file.execute(_INTENTS, (self.last_id,)).fetchall():
            intent = IntentSeen(*row)
            self.open[intent.id] = intent
            self.last_id = intent.id
            self.intents += 1
        closed = []
        for intent in tuple(self.open.values()):
            row = file.execute(_RESULTS, (intent.id,)).fetchone()
            if row is not None:
                del self.open[intent.id]
                self.booked_ml += float(row[1])
                closed.append(ResultSeen(intent, *row))
        return closed

    def _count(self, table: str) -> int:
        file = self._opened()
        return 0 if file is None else int(file.execute(f"SELECT count(*) FROM {table}").fetchone()[0])

    def _opened(self) -> sqlite3.Connection | None:
        """None as long as there is nothing to open."""
        if self._file is None and self._path is not None and self._path.exists():
            uri = f"file:{quote(str(self._path.resolve()))}?mode=ro"
            file = sqlite3.connect(uri, uri=True, isolation_level=None, check_same_thread=False)
            if file.execute("SELECT count(*) FROM sqlite_schema WHERE name = 'result'").fetchone()[0] == 0:
                file.close()
                return None
            self._file = file
        return self._file

"""The write-ahead ledger: every millilitre is on disk before it can leave the nozzle."""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import Self

from robot.errors import SprayerError
from robot.ledger.database import open_for_writing, readable_errors
from robot.ledger.lock import LedgerLock
from robot.ledger.reader import LedgerReader
from robot.ledger.records import StopLight, StopRecord
from robot.ledger.values import Checkpoint, Dangling, Intent, Outcome, Result, Task
from robot.targets.values import Target


class LedgerRuleError(SprayerError):
    """The caller asked the ledger to book what cannot be: a fault of the program, not of the file."""


def wall_clock() -> datetime:
    return datetime.now(UTC)


class Ledger(LedgerReader):
    """SQLite in WAL mode with ``synchronous=FULL``: when a method returns, its rows are on disk.

    Safe to call from any thread, one call at a time. Every method raises ``FileError`` when the file or the disk
    fails, and ``LedgerRuleError`` for a row that breaks a rule; then nothing of it is written.
    """

    def __init__(
        self, path: Path, connection: sqlite3.Connection, lock: LedgerLock, utc: Callable[[], datetime]
    ) -> None:
        super().__init__(path, connection)
        self._lock = lock
        self._utc_now = utc
        self._run_id: int | None = None

    @classmethod
    def open(cls, path: Path, utc: Callable[[], datetime] = wall_clock) -> Self:
        """Open or create the ledger for this process alone; ``BusyError`` names the process that holds it."""
        lock = LedgerLock(path)
        try:
            return cls(path, open_for_writing(path), lock, utc)
        except BaseException:
            lock.release()
            raise

    def close(self) -> None:
        super().close()
        self._lock.release()

    def begin_run(self, boot_id: str, started_utc: datetime) -> int:
        """A new run of the program; all that follows belongs to it."""
        with self._transaction() as db:
            row = db.execute("INSERT INTO run (boot_id, started_utc) VALUES (?, ?)", (boot_id, _text(started_utc)))
            self._run_id = _id(row)
        return self._run_id

    def begin_task(self, task: Task) -> int:
        with self._transaction() as db:
            row = db.execute(
                "INSERT INTO task (run_id, utc, product, registration_number, dilution_percent, operator, label_cap_ml,"
                " tank_fill_ml, water, route, config_hash, seed) VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)",
                (
                    self._run(),
                    self._now(),
                    task.product,
                    task.registration_number,
                    task.dilution_percent,
                    task.operator,
                    task.label_cap_ml,
                    task.tank_fill_ml,
                    int(task.water),
                    task.route,
                    task.config_hash,
                    task.seed,
                ),
            )
            return _id(row)

    def write_intent(self, task_id: int, intent: Intent) -> int:
        """Commit what is about to be sprayed. The target must have been written with ``upsert_targets`` before."""
        with self._transaction() as db:
            row = db.execute(
                "INSERT INTO intent (task_id, run_id, utc, target_id, stop, pulse, due_ml, dose_ml, open_s, pulse_s,"
                " full_ml, stamp_s, factor, reason) VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)",
                (
                    task_id,
                    self._run(),
                    self._now(),
                    intent.target_id,
                    intent.stop,
                    intent.pulse,
                    intent.due_ml,
                    intent.dose_ml,
                    intent.open_s,
                    intent.pulse_s,
                    intent.full_ml,
                    intent.stamp_s,
                    intent.factor,
                    intent.reason,
                ),
            )
            return _id(row)

    def write_result(self, intent_id: int, result: Result) -> None:
        """Close an intent, exactly once."""
        with self._transaction() as db:
            self._insert_result(db, intent_id, result, self._now())

    def book_dangling(self, utc: datetime) -> tuple[Dangling, ...]:
        """Book every intent that a crash left open as its full pulse, UNCERTAIN, and so its target."""
        found = self.dangling()
        with self._transaction() as db:
            for item in found:
                full = Result(
                    outcome=Outcome.UNCERTAIN,
                    booked_ml=item.intent.full_ml,
                    open_s=item.intent.pulse_s,
                    measured_ml=None,
                    reason="the program ended before the outcome was written",
                    stamp_s=item.intent.stamp_s,
                )
                self._insert_result(db, item.intent_id, full, _text(utc))
                db.execute(
                    "UPDATE target SET state = 'uncertain', reason = ? WHERE task_id = ? AND id = ?",
                    (full.reason, item.task_id, item.intent.target_id),
                )
        return found

    def upsert_targets(self, task_id: int, targets: Sequence[Target]) -> None:
        """Write targets, new or changed, all or none."""
        with self._transaction() as db:
            db.executemany(
                "INSERT INTO target (task_id, id, x_m, y_m, z_m, covariance_m2, diameter_m, diameter_sigma_m, ripeness,"
                " ripeness_score, confidence, visible_fraction, sightings, last_seen_s, state, reason, measured,"
                " ripeness_weight) VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)"
                " ON CONFLICT DO UPDATE SET"
                " x_m = excluded.x_m, y_m = excluded.y_m, z_m = excluded.z_m, covariance_m2 = excluded.covariance_m2,"
                " diameter_m = excluded.diameter_m, diameter_sigma_m = excluded.diameter_sigma_m,"
                " ripeness = excluded.ripeness, ripeness_score = excluded.ripeness_score,"
                " confidence = excluded.confidence, visible_fraction = excluded.visible_fraction,"
                " sightings = excluded.sightings, last_seen_s = excluded.last_seen_s, state = excluded.state,"
                " reason = excluded.reason, measured = excluded.measured, ripeness_weight = excluded.ripeness_weight",
                [_target_row(task_id, target) for target in targets],
            )

    def checkpoint(self, task_id: int, checkpoint: Checkpoint) -> None:
        with self._transaction() as db:
            db.execute(
                "INSERT INTO checkpoint (task_id, run_id, utc, stop, x_m, y_m, heading_rad, left_m, right_m, stamp_s)"
                " VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?)",
                (
                    task_id,
                    self._run(),
                    self._now(),
                    checkpoint.stop,
                    checkpoint.x_m,
                    checkpoint.y_m,
                    checkpoint.heading_rad,
                    checkpoint.left_m,
                    checkpoint.right_m,
                    checkpoint.stamp_s,
                ),
            )

    def record_stop(self, task_id: int, record: StopRecord) -> None:
        with self._transaction() as db:
            db.execute(
                "INSERT INTO stop (task_id, run_id, utc, row, stop, planned_x_m, x_m, y_m, heading_rad, stamp_s,"
                " frame_file, light_level, fruits_seen, light_state, plant_level, burnt_share, illumination_1_s,"
                " exposure_s, gain, lamp, light_remark)"
                " VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)",
                (
                    task_id,
                    self._run(),
                    self._now(),
                    record.row,
                    record.stop,
                    record.planned_x_m,
                    record.x_m,
                    record.y_m,
                    record.heading_rad,
                    record.stamp_s,
                    record.frame_file,
                    record.light_level,
                    record.fruits_seen,
                    *_light_columns(record.light),
                ),
            )

    def record_event(self, kind: str, text: str, stamp_s: float) -> None:
        """A state change, fault or command, for whoever reads the ledger later."""
        with self._transaction() as db:
            db.execute(
                "INSERT INTO event (run_id, utc, kind, text, stamp_s) VALUES (?, ?, ?, ?, ?)",
                (self._run(), self._now(), kind, text, stamp_s),
            )

    def _insert_result(self, db: sqlite3.Connection, intent_id: int, result: Result, utc: str) -> None:
        db.execute(
            "INSERT INTO result (intent_id, utc, outcome, booked_ml, open_s, measured_ml, reason, stamp_s)"
            " VALUES (?, ?, ?, ?, ?, ?, ?, ?)",
            (
                intent_id,
                utc,
                result.outcome.value,
                result.booked_ml,
                result.open_s,
                result.measured_ml,
                result.reason,
                result.stamp_s,
            ),
        )

    def _run(self) -> int:
        if self._run_id is None:
            raise LedgerRuleError(f"{self.path}: begin_run must come first")
        return self._run_id

    def _now(self) -> str:
        return _text(self._utc_now())

    @contextmanager
    def _transaction(self) -> Iterator[sqlite3.Connection]:
        """All or nothing, durable when left."""
        with self._one_at_a_time, readable_errors(self.path):
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


def _light_columns(light: StopLight | None) -> tuple[object, ...]:
    if light is None:
        return (None,) * 8
    return (
        light.state.value,
        light.plant_level,
        light.burnt_share,
        light.illumination_1_s,
        light.exposure_s,
        light.gain,
        int(light.lamp),
        light.remark,
    )


def _id(row: sqlite3.Cursor) -> int:
    assert row.lastrowid is not None
    return row.lastrowid


def _text(utc: datetime) -> str:
    if utc.utcoffset() is None:
        raise LedgerRuleError(f"expected a time with its zone, found {utc.isoformat()}; give UTC")
    return utc.astimezone(UTC).isoformat(timespec="milliseconds")


def _target_row(task_id: int, target: Target) -> tuple[object, ...]:
    c = target.covariance_m2
    covariance = [float(c[i, j]) for i, j in ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))]
    return (
        task_id,
        target.id,
        *(float(value) for value in target.centre_m),
        json.dumps(covariance, allow_nan=False),
        float(target.diameter_m),
        float(target.diameter_sigma_m),
        target.ripeness.value,
        float(target.ripeness_score),
        float(target.confidence),
        float(target.visible_fraction),
        target.sightings,
        float(target.last_seen_s),
        target.state.value,
        target.reason,
        int(target.measured),
        float(target.ripeness_weight),
    )

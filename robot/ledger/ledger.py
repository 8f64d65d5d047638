"""The write-ahead ledger: every millilitre is on disk before it can leave the nozzle."""

from __future__ import annotations

import math
import sqlite3
from collections.abc import Sequence
from datetime import datetime

from robot.ledger import outbox
from robot.ledger.certainty import last_intent, unclear
from robot.ledger.columns import light_columns, target_columns
from robot.ledger.outbox import Parcel
from robot.ledger.records import StopRecord
from robot.ledger.refills import REFILL, refill_text
from robot.ledger.values import Checkpoint, Dangling, Intent, Leak, Outcome, Result, Task
from robot.ledger.writing import LedgerRuleError, LedgerWriter, in_utc, new_id
from robot.targets.values import Target, TargetState


class Ledger(LedgerWriter):
    """SQLite in WAL mode with ``synchronous=FULL``: when a method returns, its rows are on disk.

    Safe to call from any thread, one call at a time. Every method raises ``FileError`` when the file or the disk
    fails, and ``LedgerRuleError`` for a row that breaks a rule; then nothing of it is written. What must not be lost
    (outcomes, leaks, events) is written into the room of the reserve when the disk is full; then no intent is taken.
    """

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
            return new_id(row)

    def write_intent(self, task_id: int, intent: Intent) -> int:
        """Commit what is about to be sprayed. The target must have been written with ``upsert_targets`` before.

        ``LedgerRuleError`` for a target that an earlier shot left uncertain, unless an operator has released it.
        """
        self._demand_reserve()
        with self._transaction() as db:
            if unclear(db, task_id, intent.target_id):
                raise LedgerRuleError(
                    f"{self.path}: target {intent.target_id} of task {task_id} is uncertain: nobody knows what it got; "
                    "an operator must release it before it is sprayed again"
                )
            row = db.execute(
                "INSERT INTO intent (task_id, run_id, utc, target_id, stop, pulse, due_ml, dose_ml, open_s, pulse_s,"
                " full_ml, stamp_s, factor, reason, model_ml) VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)",
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
                    intent.model_ml,
                ),
            )
            return new_id(row)

    def write_result(self, intent_id: int, result: Result, count_ml: float | None = None) -> None:
        """Close an intent, exactly once. ``count_ml`` is the meter's count up to which everything is booked by it."""

        def write() -> None:
            with self._transaction() as db:
                self._insert_result(db, intent_id, result, self._now())
                row = db.execute("SELECT task_id FROM intent WHERE id = ?", (intent_id,)).fetchone()
                self._mark(db, row[0], count_ml)

        self._must_be_kept(write)

    def book_dangling(self, utc: datetime) -> tuple[Dangling, ...]:
        """Book every intent that a crash left open as its full pulse, UNCERTAIN, and so its target."""

        def write() -> tuple[Dangling, ...]:
            found = self.dangling()
            with self._transaction() as db:
                for item in found:
                    self._book_in_full(db, item, in_utc(utc))
            return found

        return self._must_be_kept(write)

    def _book_in_full(self, db: sqlite3.Connection, item: Dangling, utc: str) -> None:
        full = Result(
            outcome=Outcome.UNCERTAIN,
            booked_ml=item.intent.full_ml,
            open_s=item.intent.pulse_s,
            measured_ml=None,
            reason="the program ended before the outcome was written",
            stamp_s=item.intent.stamp_s,
        )
        self._insert_result(db, item.intent_id, full, utc)
        db.execute(
            "UPDATE target SET state = 'uncertain', reason = ? WHERE task_id = ? AND id = ?",
            (full.reason, item.task_id, item.intent.target_id),
        )

    def write_leak(self, task_id: int | None, leak: Leak, count_ml: float | None = None) -> int:
        """Book liquid that belongs to no shot. ``task_id`` None: no task was open; ``count_ml`` as for a result."""

        def write() -> int:
            with self._transaction() as db:
                row = db.execute(
                    "INSERT INTO leak (task_id, run_id, utc, booked_ml, measured_ml, reason, stamp_s)"
                    " VALUES (?, ?, ?, ?, ?, ?, ?)",
                    (task_id, self._run(), self._now(), leak.booked_ml, leak.measured_ml, leak.reason, leak.stamp_s),
                )
                outbox.put(db, self._run(), Parcel.LEAK, new_id(row))
                self._mark(db, task_id, count_ml)
                return new_id(row)

        return self._must_be_kept(write)

    def mark_meter(self, task_id: int | None, count_ml: float) -> None:
        """Everything up to this count of the flow meter is booked; what passes it from here on is to be."""
        with self._transaction() as db:
            self._mark(db, task_id, count_ml)

    def release_target(self, task_id: int, target_id: int, operator: str, reason: str) -> int:
        """An operator's word that an uncertain target may be sprayed again: it is open from here on.

        What it may have got still counts for its cap. ``LedgerRuleError`` for a target that is not uncertain, and while
        the outcome of a shot at it is still to be written.
        """
        found = {target.id: target for target in self.targets(task_id)}.get(target_id)
        if found is None:
            raise LedgerRuleError(f"{self.path}: task {task_id} has no target {target_id}; look at its report")
        if found.state is not TargetState.UNCERTAIN:
            raise LedgerRuleError(
                f"{self.path}: target {target_id} of task {task_id} is {found.state}; only an uncertain one is released"
            )
        with self._transaction() as db:
            last, unknown = last_intent(db, task_id, target_id)
            if last is None or unknown:
                raise LedgerRuleError(
                    f"{self.path}: target {target_id} of task {task_id} has no shot with an outcome; "
                    "let the program book it first"
                )
            row = db.execute(
                "INSERT INTO release (task_id, target_id, run_id, utc, operator, reason, last_intent_id)"
                " VALUES (?, ?, ?, ?, ?, ?, ?)",
                (task_id, target_id, self._run(), self._now(), operator, reason, last),
            )
            db.execute(
                "UPDATE target SET state = 'open', reason = ? WHERE task_id = ? AND id = ?",
                (f"released by {operator}: {reason}", task_id, target_id),
            )
            outbox.put(db, self._run(), Parcel.RELEASE, new_id(row))
            return new_id(row)

    def acknowledge(self, seqs: Sequence[int]) -> None:
        """The uplink has delivered these rows of the outbox; a number that is gone already is no error."""
        with self._transaction() as db:
            outbox.remove(db, seqs)

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
                [target_columns(task_id, target) for target in targets],
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
                    *light_columns(record.light),
                ),
            )

    def record_event(self, kind: str, text: str, stamp_s: float) -> None:
        """A state change, fault or command, for whoever reads the ledger later."""

        def write() -> None:
            with self._transaction() as db:
                row = db.execute(
                    "INSERT INTO event (run_id, utc, kind, text, stamp_s) VALUES (?, ?, ?, ?, ?)",
                    (self._run(), self._now(), kind, text, stamp_s),
                )
                outbox.put(db, self._run(), outbox.parcel_of_event(kind), new_id(row))

        self._must_be_kept(write)

    def write_refill(self, task_id: int, tank_ml: float, cause: str, stamp_s: float) -> None:
        """An operator's word that the tank held this much at ``stamp_s``, while no shot was under way.

        ``LedgerRuleError`` unless it is above 0.
        """
        if not 0.0 < tank_ml < math.inf:
            raise LedgerRuleError(f"{self.path}: a refill is of more than 0 ml, found {tank_ml}")
        self.record_event(REFILL, refill_text(task_id, tank_ml, cause), stamp_s)

    def _mark(self, db: sqlite3.Connection, task_id: int | None, count_ml: float | None) -> None:
        if count_ml is not None:
            db.execute(
                "INSERT OR REPLACE INTO meter (only, run_id, task_id, count_ml, last_intent_id)"
                " VALUES (1, ?, ?, ?, (SELECT coalesce(max(id), 0) FROM intent))",
                (self._run(), task_id, count_ml),
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
        outbox.put(db, self._run(), Parcel.SHOT, intent_id)

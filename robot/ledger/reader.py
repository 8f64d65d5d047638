"""Reading the ledger: for reports, and for a robot that resumes."""

from __future__ import annotations

import sqlite3
import threading
from collections.abc import Sequence
from datetime import datetime
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from robot.errors import FileError
from robot.ledger import outbox
from robot.ledger.database import open_for_reading, readable_errors
from robot.ledger.from_columns import SHOT_COLUMNS, shot_of, stop_of, target_of, utc_of
from robot.ledger.outbox import OutboxRow, Parcel
from robot.ledger.records import EventRow, LeakRow, MeterMark, ReleaseRow, ShotRow, StopRow, TaskRow, Totals
from robot.ledger.refills import BOOKED_SINCE, REFILLS, Refill, refill_of
from robot.ledger.sums import GIVEN, MINUTE, Given, Sums, add_up, day_of
from robot.ledger.values import Checkpoint, Dangling, Leak, Outcome, Task
from robot.targets.values import Target


class LedgerReader:
    """Read access. Safe to call from any thread, one call at a time; every method raises ``FileError``."""

    def __init__(self, path: Path, connection: sqlite3.Connection) -> None:
        self.path = path
        self._connection = connection
        self._one_at_a_time = threading.Lock()

    @classmethod
    def open_read_only(cls, path: Path) -> LedgerReader:
        """Open an existing ledger without writing to it, also while a robot uses it."""
        return LedgerReader(path, open_for_reading(path))

    def close(self) -> None:
        with self._one_at_a_time:
            self._connection.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def tasks(self) -> tuple[TaskRow, ...]:
        rows = self._rows("SELECT id, run_id, utc FROM task ORDER BY id")
        return tuple(TaskRow(row[0], row[1], utc_of(row[2])) for row in rows)

    def latest_task(self) -> int | None:
        """Number of the newest task, None in an empty ledger."""
        return self._rows("SELECT max(id) FROM task")[0][0]  # type: ignore[no-any-return]

    def task(self, task_id: int) -> Task:
        rows = self._rows(
            "SELECT product, registration_number, dilution_percent, operator, label_cap_ml, tank_fill_ml, water, route,"
            " config_hash, seed FROM task WHERE id = ?",
            task_id,
        )
        if not rows:
            raise FileError(f"{self.path}: has no task {task_id}; its newest is {self.latest_task()}")
        product, registration, dilution, operator, cap_ml, fill_ml, water, route, config_hash, seed = rows[0]
        return Task(product, registration, dilution, operator, cap_ml, fill_ml, bool(water), route, config_hash, seed)

    def targets(self, task_id: int) -> tuple[Target, ...]:
        """The task's targets by id. A target for which the valve opened, or may have, since an operator last released
        it, is never open: it is sprayed or uncertain even if a crash came before its new state was written."""
        rows = self._rows(
            "SELECT id, x_m, y_m, z_m, covariance_m2, diameter_m, diameter_sigma_m, ripeness, ripeness_score,"
            " ripeness_weight, confidence, visible_fraction, measured, sightings, last_seen_s, state, reason"
            " FROM target WHERE task_id = ? ORDER BY id",
            task_id,
        )
        shots: dict[int, list[ShotRow]] = {}
        released = {row.target_id: row.last_intent_id for row in self.releases(task_id)}
        for shot in self.shots(task_id):
            if shot.intent_id > released.get(shot.intent.target_id, 0):
                shots.setdefault(shot.intent.target_id, []).append(shot)
        return tuple(target_of(row, shots.get(row[0], [])) for row in rows)

    def shots(self, task_id: int) -> tuple[ShotRow, ...]:
        """Every pulse of a task in the order of writing."""
        return tuple(
            shot_of(row)
            for row in self._rows(f"SELECT {SHOT_COLUMNS} WHERE intent.task_id = ? ORDER BY intent.id", task_id)
        )

    def dangling(self) -> tuple[Dangling, ...]:
        """Intents of all tasks without a result."""
        rows = self._rows(f"SELECT {SHOT_COLUMNS} WHERE result.intent_id IS NULL ORDER BY intent.id")
        return tuple(Dangling(row[0], row[1], shot_of(row).intent) for row in rows)

    def leaks(self, task_id: int | None = None) -> tuple[LeakRow, ...]:
        """Every leak in the order of writing: of a task, or all, those without a task too."""
        rows = self._rows(
            "SELECT id, task_id, run_id, booked_ml, measured_ml, reason, stamp_s, utc FROM leak"
            " WHERE ?1 IS NULL OR task_id = ?1 ORDER BY id",
            task_id,
        )
        return tuple(LeakRow(row[0], row[1], row[2], Leak(*row[3:7]), utc_of(row[7])) for row in rows)

    def releases(self, task_id: int) -> tuple[ReleaseRow, ...]:
        """What operators released, in the order of writing."""
        rows = self._rows(
            "SELECT id, task_id, target_id, run_id, operator, reason, last_intent_id, utc FROM release"
            " WHERE task_id = ? ORDER BY id",
            task_id,
        )
        return tuple(
            ReleaseRow(number, task, target_id, run_id, operator, reason, last, utc_of(utc))
            for number, task, target_id, run_id, operator, reason, last, utc in rows
        )

    def totals(self, task_id: int) -> Totals:
        shots = self.shots(task_id)
        results = [shot.result for shot in shots if shot.result is not None]
        leaks = [row.leak for row in self.leaks(task_id)]
        leaked_ml = sum(leak.booked_ml for leak in leaks)
        return Totals(
            booked_ml=sum(result.booked_ml for result in results) + leaked_ml,
            pending_ml=sum(shot.intent.full_ml for shot in shots if shot.result is None),
            measured_ml=sum(result.measured_ml or 0.0 for result in results) + sum(leak.measured_ml for leak in leaks),
            pulses={kind: sum(result.outcome is kind for result in results) for kind in Outcome},
            leaked_ml=leaked_ml,
        )

    def sums(self, task_id: int, now: datetime) -> Sums:
        """What caps begin with at ``now`` (UTC): all that earlier runs gave, or may have given."""
        since = min(day_of(now), now - MINUTE).isoformat(timespec="milliseconds")
        given = [
            Given(task, route, target_id, x_m, y_m, utc_of(utc), ml)
            for task, route, target_id, x_m, y_m, utc, ml in self._rows(GIVEN, task_id, since)
        ]
        return add_up(given, task_id, self.task(task_id).route, now)

    def last_refill(self, task_id: int) -> Refill | None:
        """The newest refill of the tank while this was the task; None when there was none."""
        refills = (refill_of(*row) for row in self._rows(REFILLS))
        return next((refill for refill in refills if refill.task_id == task_id), None)

    def booked_since_ml(self, refill: Refill) -> float:
        """What left the tank since then, or may have: shots of every task, those without an outcome in full, leaks."""
        return float(self._rows(BOOKED_SINCE, refill.run_id, refill.stamp_s)[0][0])

    def flow_history(self, count: int) -> tuple[tuple[float, float], ...]:
        """(millilitres by the flow model, by the meter) of the newest whole shots, oldest first; at most ``count``.

        Only those since the newest event "nozzle", by which an operator says that the nozzle was seen to.
        """
        rows = self._rows(
            "WITH checked AS (SELECT run_id, stamp_s FROM event WHERE kind = 'nozzle' ORDER BY id DESC LIMIT 1)"
            " SELECT model_ml, measured_ml FROM intent JOIN result ON result.intent_id = intent.id"
            " WHERE model_ml > 0 AND measured_ml IS NOT NULL AND outcome IN ('sprayed', 'uncertain') AND NOT EXISTS"
            " (SELECT 1 FROM checked WHERE (intent.run_id, result.stamp_s) <= (checked.run_id, checked.stamp_s))"
            " ORDER BY intent.id DESC LIMIT ?",
            count,
        )
        return tuple((model_ml, measured_ml) for model_ml, measured_ml in reversed(rows))

    def meter_mark(self) -> MeterMark | None:
        """Where the last run left the flow meter; None when no run of this program has read it."""
        rows = self._rows(
            "SELECT task_id, count_ml, (SELECT coalesce(sum(coalesce(booked_ml, full_ml)), 0.0) FROM intent"
            " LEFT JOIN result ON result.intent_id = intent.id WHERE intent.id > last_intent_id) FROM meter"
        )
        return MeterMark(*rows[0]) if rows else None

    def outbox(self, count: int, after: int = 0) -> tuple[OutboxRow, ...]:
        """The oldest ``count`` rows with a number above ``after`` that wait for the uplink, in order."""
        rows = self._rows(outbox.PENDING, after, count)
        return tuple(OutboxRow(seq, boot, run_id, Parcel(kind), number) for seq, boot, run_id, kind, number in rows)

    def outbox_waiting(self) -> int:
        """How many rows the uplink has still to deliver."""
        return int(self._rows(outbox.WAITING)[0][0])

    def outbox_dropped(self) -> int:
        """How many events were dropped undelivered, ever."""
        return int(self._rows(outbox.DROPPED)[0][0])

    def last_checkpoint(self, task_id: int) -> Checkpoint | None:
        rows = self._rows(
            "SELECT stop, x_m, y_m, heading_rad, left_m, right_m, stamp_s FROM checkpoint WHERE task_id = ?"
            " ORDER BY id DESC LIMIT 1",
            task_id,
        )
        return Checkpoint(*rows[0]) if rows else None

    def stops(self, task_id: int) -> tuple[StopRow, ...]:
        light = "light_state, plant_level, burnt_share, illumination_1_s, exposure_s, gain, lamp, light_remark"
        rows = self._rows(
            "SELECT run_id, utc, row, stop, planned_x_m, x_m, y_m, heading_rad, stamp_s, frame_file, light_level,"
            f" fruits_seen, {light} FROM stop WHERE task_id = ? ORDER BY id",
            task_id,
        )
        return tuple(StopRow(row[0], stop_of(row[2:]), utc_of(row[1])) for row in rows)

    def last_event(self, kind: str) -> EventRow | None:
        """The newest event of this kind, of any run; None when there is none."""
        rows = self._rows(
            "SELECT id, run_id, kind, text, stamp_s, utc FROM event WHERE kind = ? ORDER BY id DESC LIMIT 1", kind
        )
        return _event_of(rows[0]) if rows else None

    def events(self, *kinds: str) -> tuple[EventRow, ...]:
        """Events of all runs in the order of writing; of these kinds, or all."""
        rows = self._rows("SELECT id, run_id, kind, text, stamp_s, utc FROM event ORDER BY id")
        return tuple(_event_of(row) for row in rows if not kinds or row[2] in kinds)

    def _rows(self, query: str, *values: object) -> Sequence[Any]:
        with self._one_at_a_time, readable_errors(self.path):
            return self._connection.execute(query, values).fetchall()


def _event_of(row: Sequence[Any]) -> EventRow:
    number, run_id, kind, text, stamp_s, utc = row
    return EventRow(number, run_id, kind, text, stamp_s, utc_of(utc))

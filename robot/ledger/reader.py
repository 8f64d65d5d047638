"""Reading the ledger: for reports, and for a robot that resumes."""

from __future__ import annotations

import json
import sqlite3
import threading
from collections.abc import Sequence
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np

from robot.errors import FileError
from robot.ledger.database import open_for_reading, readable_errors
from robot.ledger.records import EventRow, ShotRow, StopLight, StopRecord, StopRow, TaskRow, Totals
from robot.ledger.values import Checkpoint, Dangling, Intent, Outcome, Result, Task
from robot.targets.values import Target, TargetState
from robot.vision.light import LightState
from robot.vision.values import Ripeness

_SHOT_COLUMNS = """
    intent.id, intent.task_id, intent.run_id, intent.utc, target_id, stop, pulse, due_ml, dose_ml, intent.open_s,
    pulse_s, full_ml, intent.stamp_s, factor, intent.reason,
    result.utc, outcome, booked_ml, result.open_s, measured_ml, result.reason, result.stamp_s
    FROM intent LEFT JOIN result ON result.intent_id = intent.id
"""


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
        return tuple(TaskRow(row[0], row[1], _utc(row[2])) for row in rows)

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
        """The task's targets by id. A target for which the valve opened, or may have, is never open:
        it is sprayed or uncertain even if a crash came before its new state was written."""
        rows = self._rows(
            "SELECT id, x_m, y_m, z_m, covariance_m2, diameter_m, diameter_sigma_m, ripeness, ripeness_score,"
            " ripeness_weight, confidence, visible_fraction, measured, sightings, last_seen_s, state, reason"
            " FROM target WHERE task_id = ? ORDER BY id",
            task_id,
        )
        shots: dict[int, list[ShotRow]] = {}
        for shot in self.shots(task_id):
            shots.setdefault(shot.intent.target_id, []).append(shot)
        return tuple(_target(row, shots.get(row[0], [])) for row in rows)

    def shots(self, task_id: int) -> tuple[ShotRow, ...]:
        """Every pulse of a task in the order of writing."""
        return tuple(
            _shot(row)
            for row in self._rows(f"SELECT {_SHOT_COLUMNS} WHERE intent.task_id = ? ORDER BY intent.id", task_id)
        )

    def dangling(self) -> tuple[Dangling, ...]:
        """Intents of all tasks without a result."""
        rows = self._rows(f"SELECT {_SHOT_COLUMNS} WHERE result.intent_id IS NULL ORDER BY intent.id")
        return tuple(Dangling(row[0], row[1], _shot(row).intent) for row in rows)

    def totals(self, task_id: int) -> Totals:
        shots = self.shots(task_id)
        results = [shot.result for shot in shots if shot.result is not None]
        return Totals(
            booked_ml=sum(result.booked_ml for result in results),
            pending_ml=sum(shot.intent.full_ml for shot in shots if shot.result is None),
            measured_ml=sum(result.measured_ml or 0.0 for result in results),
            pulses={kind: sum(result.outcome is kind for result in results) for kind in Outcome},
        )

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
        return tuple(StopRow(row[0], _stop(row[2:]), _utc(row[1])) for row in rows)

    def events(self, *kinds: str) -> tuple[EventRow, ...]:
        """Events of all runs in the order of writing; of these kinds, or all."""
        rows = self._rows("SELECT id, run_id, kind, text, stamp_s, utc FROM event ORDER BY id")
        return tuple(
            EventRow(number, run_id, kind, text, stamp_s, _utc(utc))
            for number, run_id, kind, text, stamp_s, utc in rows
            if not kinds or kind in kinds
        )

    def _rows(self, query: str, *values: object) -> Sequence[Any]:
        with self._one_at_a_time, readable_errors(self.path):
            return self._connection.execute(query, values).fetchall()


def _utc(text: str) -> datetime:
    return datetime.fromisoformat(text)


def _stop(row: Sequence[Any]) -> StopRecord:
    *stop, state, level, burnt, illumination, exposure_s, gain, lamp, remark = row
    light = None
    if state is not None:
        light = StopLight(LightState(state), level, burnt, illumination, exposure_s, gain, bool(lamp), remark)
    return replace(StopRecord(*stop), light=light)


def _shot(row: Sequence[Any]) -> ShotRow:
    intent_id, task_id, run_id, utc, *planned = row[:15]
    result_utc, outcome, booked_ml, opened_s, measured_ml, reason, result_stamp_s = row[15:]
    return ShotRow(
        intent_id=intent_id,
        task_id=task_id,
        run_id=run_id,
        intent=Intent(*planned),
        utc=_utc(utc),
        result=None
        if outcome is None
        else Result(Outcome(outcome), booked_ml, opened_s, measured_ml, reason, result_stamp_s),
        result_utc=None if result_utc is None else _utc(result_utc),
    )


def _target(row: Sequence[Any], shots: Sequence[ShotRow]) -> Target:
    target_id, x_m, y_m, z_m, covariance, *figures, state, reason = row
    diameter_m, diameter_sigma_m, ripeness, score, weight, *figures = figures
    confidence, visible, measured, sightings, last_seen_s = figures
    xx, xy, xz, yy, yz, zz = json.loads(covariance)
    state, reason = _true_state(TargetState(state), reason, shots)
    return Target(
        id=target_id,
        centre_m=np.array([x_m, y_m, z_m]),
        covariance_m2=np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]),
        diameter_m=diameter_m,
        diameter_sigma_m=diameter_sigma_m,
        ripeness=Ripeness(ripeness),
        ripeness_score=score,
        ripeness_weight=weight,
        confidence=confidence,
        visible_fraction=visible,
        measured=bool(measured),
        sightings=sightings,
        last_seen_s=last_seen_s,
        state=state,
        reason=reason,
    )


def _true_state(state: TargetState, reason: str, shots: Sequence[ShotRow]) -> tuple[TargetState, str]:
    opened = [shot.result for shot in shots if shot.result is None or shot.result.outcome is not Outcome.NOT_OPENED]
    if not opened or state in (TargetState.SPRAYED, TargetState.UNCERTAIN):
        return state, reason
    if all(result is not None and result.outcome is Outcome.SPRAYED for result in opened):
        return TargetState.SPRAYED, "sprayed before the program was stopped"
    return TargetState.UNCERTAIN, "the valve opened for it before the program was stopped"

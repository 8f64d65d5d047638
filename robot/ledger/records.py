"""What the ledger keeps beside the shots, and what a reader gets."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime

from robot.ledger.values import Intent, Leak, Outcome, Result
from robot.vision.light import LightState


@dataclass(frozen=True, slots=True)
class StopLight:
    """In what light a stop was looked at.

    ``plant_level`` and ``burnt_share`` (0..1) are of the plants, linear; ``illumination_1_s`` is independent of
    ``exposure_s`` and ``gain``; ``lamp`` whether it was lit; ``remark`` what a person should know of it.
    """

    state: LightState
    plant_level: float
    burnt_share: float
    illumination_1_s: float
    exposure_s: float
    gain: float
    lamp: bool
    remark: str = ""


@dataclass(frozen=True, slots=True)
class StopRecord:
    """One detection at a stop: where the rover should be and believes to be (row frame), and what it saw.

    ``frame_file`` is a file name in the run's folder, "" when no frame was kept. ``light_level`` is the frame's mean
    grey, 0..255. ``stamp_s`` is the frame's. ``light`` None: an older program wrote the stop, which did not meter.
    """

    row: str
    stop: int
    planned_x_m: float
    x_m: float
    y_m: float
    heading_rad: float
    stamp_s: float
    frame_file: str
    light_level: float
    fruits_seen: int
    light: StopLight | None = None


@dataclass(frozen=True, slots=True)
class StopRow:
    """A stop as it stands in the ledger."""

    run_id: int
    record: StopRecord
    utc: datetime


@dataclass(frozen=True, slots=True)
class EventRow:
    """A state change or fault, in the order of writing."""

    id: int
    run_id: int
    kind: str
    text: str
    stamp_s: float
    utc: datetime


@dataclass(frozen=True, slots=True)
class ShotRow:
    """One pulse: its intent, and its result (None while the valve may be open, or after a crash)."""

    intent_id: int
    task_id: int
    run_id: int
    intent: Intent
    utc: datetime
    result: Result | None
    result_utc: datetime | None


@dataclass(frozen=True, slots=True)
class Totals:
    """Sums of a task. ``pending_ml`` is the full pulse of every intent without a result.

    ``booked_ml`` and ``measured_ml`` are of shots and leaks together, ``leaked_ml`` is what of ``booked_ml`` leaked.
    What left the nozzle is at most ``booked_ml + pending_ml``.
    """

    booked_ml: float
    pending_ml: float
    measured_ml: float
    pulses: Mapping[Outcome, int]
    leaked_ml: float = 0.0


@dataclass(frozen=True, slots=True)
class LeakRow:
    """A leak as it stands in the ledger. ``task_id`` None: no task was open."""

    id: int
    task_id: int | None
    run_id: int
    leak: Leak
    utc: datetime


@dataclass(frozen=True, slots=True)
class ReleaseRow:
    """An operator's word that an uncertain target may be sprayed again, and why.

    It speaks of the shots up to ``last_intent_id``: a later one makes the target uncertain again.
    """

    id: int
    task_id: int
    target_id: int
    run_id: int
    operator: str
    reason: str
    last_intent_id: int
    utc: datetime


@dataclass(frozen=True, slots=True)
class TaskRow:
    """A task with its number, start and the runs that worked on it."""

    task_id: int
    run_id: int
    utc: datetime


@dataclass(frozen=True, slots=True)
class MeterMark:
    """Up to which count of the flow meter everything is booked, on which task.

    ``covered_ml`` was booked since on shots whose count nobody read: what passed the meter may be theirs.
    """

    task_id: int | None
    count_ml: float
    covered_ml: float

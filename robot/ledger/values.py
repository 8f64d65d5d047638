"""The rows of the ledger."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum


@dataclass(frozen=True, slots=True)
class Task:
    """What is applied, by whom, and how much at most.

    ``label_cap_ml`` is the most that this task may give in all; ``tank_fill_ml`` what was filled in at its start;
    ``water`` says that the tank holds water only (a test); ``config_hash`` ties the task to its configuration.
    """

    product: str
    registration_number: str
    dilution_percent: float
    operator: str
    label_cap_ml: float
    tank_fill_ml: float
    water: bool
    route: str
    config_hash: str
    seed: int | None


class Outcome(StrEnum):
    """How an intent ended."""

    SPRAYED = "sprayed"      # opened and verified shut
    SHORTENED = "shortened"  # shut before its time (stop), booked by the time it was open
    UNCERTAIN = "uncertain"  # nobody knows how long: booked as the full pulse
    NOT_OPENED = "not_opened"  # proven that the valve never opened: booked 0


@dataclass(frozen=True, slots=True)
class Intent:
    """Written before the valve opens. ``full_ml`` is what the board's whole pulse could give: the upper bound.

    ``due_ml`` the figure of law and ripeness, ``dose_ml`` the commanded one, ``open_s`` the commanded coil time,
    ``pulse_s`` the board's own timer. ``factor`` of ripeness is already in ``due_ml``; ``reason`` says why the dose is
    not simply that of a measured fruit (a limit, a fruit too hidden to measure), "" when it is. ``model_ml`` is what
    the flow model expects of ``open_s``, None from an older program.
    """

    target_id: int
    stop: int
    pulse: int
    due_ml: float
    dose_ml: float
    open_s: float
    pulse_s: float
    full_ml: float
    stamp_s: float
    factor: float = 1.0
    reason: str = ""
    model_ml: float | None = None


@dataclass(frozen=True, slots=True)
class Result:
    """Written after the valve is shut. ``measured_ml`` is the flow meter's figure, None without one."""

    outcome: Outcome
    booked_ml: float
    open_s: float
    measured_ml: float | None
    reason: str
    stamp_s: float


@dataclass(frozen=True, slots=True)
class Leak:
    """Liquid that passed the flow meter and belongs to no shot: the valve should have been shut.

    ``measured_ml`` is the meter's figure, ``booked_ml`` that widened by the meter's tolerance.
    """

    booked_ml: float
    measured_ml: float
    reason: str
    stamp_s: float


@dataclass(frozen=True, slots=True)
class Dangling:
    """An intent that a crash left without an outcome."""

    intent_id: int
    task_id: int
    intent: Intent


@dataclass(frozen=True, slots=True)
class Checkpoint:
    """Where the rover stood: row-frame pose together with the wheel counters at that moment, and the stop it was at."""

    stop: int
    x_m: float
    y_m: float
    heading_rad: float
    left_m: float
    right_m: float
    stamp_s: float

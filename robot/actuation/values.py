"""What the hands are told and what they answer."""

from __future__ import annotations

import math
from dataclasses import dataclass

from robot.errors import SprayerError
from robot.safety import Cell

LEDGER_WRITE_S = 0.002  # modelled duration of one durable transaction in virtual time


class Refused(SprayerError):
    """Safety did not allow a command; the message holds its reasons."""


@dataclass(frozen=True, slots=True)
class HandSettings:
    """What the hands need to know of the machine."""

    stow_rad: tuple[float, ...]
    settle_tolerance_rad: float
    settle_s: float
    settle_timeout_s: float
    pump_lease_s: float
    meter_ml_per_pulse: float
    meter_tolerance: float
    valve_close_s: float
    tank_reserve_ml: float = 0.0
    tank_ml: float = math.inf


@dataclass(frozen=True, slots=True)
class PulseOrder:
    """One valve opening of a shot. ``model_ml`` is what the flow model expects of ``open_s``; ``full_ml`` the most that
    the board's whole pulse of ``pulse_s`` can give; ``factor`` and ``reason`` as in the ledger's intent; ``cell`` the
    square metre of the row in which the target stands."""

    target_id: int
    stop: int
    number: int
    due_ml: float
    dose_ml: float
    model_ml: float
    open_s: float
    pulse_s: float
    full_ml: float
    factor: float = 1.0
    reason: str = ""
    cell: Cell | None = None


@dataclass(frozen=True, slots=True)
class PartStopped:
    """One line of the report of a stop; ``error`` is "" when the part did as told."""

    part: str
    error: str

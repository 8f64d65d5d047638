"""What the monitors are told, and what they answer."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True, slots=True)
class Line:
    """One line of the twin's truth: a ``command`` (``what`` is "device verb"), an ``event``, a ``state`` or a ``view``.

    ``t_s`` is in the soak's clock, which runs on over rows and restarts.
    """

    t_s: float
    kind: str
    what: str
    detail: Mapping[str, Any]

    def __str__(self) -> str:
        return f"{self.t_s:.3f} s  {self.kind} {self.what} {dict(self.detail)}"


@dataclass(frozen=True, slots=True)
class Violation:
    """The first time that a property did not hold: what was seen, and what happened just before, oldest first."""

    property: str
    t_s: float
    life: int
    text: str
    before: tuple[str, ...] = field(repr=False)


@dataclass(frozen=True, slots=True)
class Rules:
    """What the machine under watch is configured to keep to."""

    max_pulse_s: float
    max_shot_ml: float
    max_target_ml: float
    max_minute_ml: float
    max_task_ml: float
    pump_lease_s: float
    drive_timeout_s: float
    drive_braking_s: float
    valve_open_s: float
    valve_close_s: float
    full_flow_ml_s: float

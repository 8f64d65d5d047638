"""The caps of a configuration, inside an envelope that no configuration can widen."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

from robot.safety.timing import PULSE_HARD_MAX_S

_ENVELOPE = {
    "max_shot_ml": 50.0,
    "max_target_ml": 100.0,
    "max_cell_ml": 2000.0,
    "max_minute_ml": 1000.0,
    "max_task_ml": 500_000.0,
    "max_day_ml": 1_000_000.0,
    "max_pulse_s": PULSE_HARD_MAX_S,
    "max_base_speed_m_s": 1.0,
    "tank_reserve_ml": 50_000.0,
    "min_pressure_bar": 20.0,
    "battery_low_v": 100.0,
    "battery_stop_v": 100.0,
}


@dataclass(frozen=True, slots=True)
class Limits:
    """Caps on liquid (``max_cell_ml`` a square metre) and motion, and the voltages below which the machine pauses and
    stops (0: not watched). ``ValueError`` when one lies outside the hard envelope."""

    max_shot_ml: float
    max_target_ml: float
    max_cell_ml: float
    max_minute_ml: float
    max_task_ml: float
    max_day_ml: float
    max_pulse_s: float
    max_base_speed_m_s: float
    tank_reserve_ml: float
    min_pressure_bar: float
    battery_low_v: float = 0.0
    battery_stop_v: float = 0.0

    def __post_init__(self) -> None:
        for field in fields(self):
            value, bound = getattr(self, field.name), _ENVELOPE[field.name]
            if not (math.isfinite(value) and 0.0 <= value <= bound):
                raise ValueError(f"{field.name} must be between 0 and {bound} (hard envelope), found {value}")
        if self.battery_stop_v > self.battery_low_v:
            raise ValueError(
                f"battery_stop_v ({self.battery_stop_v}) must not exceed battery_low_v ({self.battery_low_v})"
            )

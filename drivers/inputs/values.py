"""What the rover's sensors say."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class InputState:
    """One reading of all inputs at ``stamp_s`` (loop time).

    ``estop_pressed`` and ``bumper_pressed`` come from normally closed contacts (a broken wire reads pressed).
    ``flow_total_ml`` counts up from power-on (a flow meter's pulses); ``flow_ml_s`` is its present rate.
    """

    stamp_s: float
    estop_pressed: bool
    bumper_pressed: bool
    tank_level_ml: float
    flow_ml_s: float
    flow_total_ml: float
    pressure_bar: float
    roll_rad: float
    pitch_rad: float
    battery_v: float

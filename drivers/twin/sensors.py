"""The inputs: e-stop, bumper, level, flow, pressure, tilt, battery."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from drivers.inputs.values import InputState
from drivers.twin.deviations import TrueMachine
from drivers.twin.nominal import Nominal

LEVEL_NOISE_SHARE = 0.002
PRESSURE_NOISE_BAR = 0.01
TILT_NOISE_RAD = math.radians(0.1)
METER_FLOOR_ML_S = 5.0
FLOW_NOISE_SHARE = 0.01
BATTERY_FULL_V = 25.8
BATTERY_DROP_V_S = 0.3 / 3600.0
BATTERY_NOISE_V = 0.02


@dataclass(frozen=True, slots=True)
class Liquid:
    """The liquid as it truly is."""

    tank_ml: float
    flow_ml_s: float
    total_ml: float
    pressure_bar: float


class Sensors:
    """What people and ground do to the inputs, and how the sensors see the liquid."""

    def __init__(self, nominal: Nominal, true: TrueMachine) -> None:
        self._true = true
        self._tank_ml = nominal.tank_ml
        self._pulse_ml = 1000.0 / nominal.flow_meter_pulses_per_l
        self.estop_pressed = False
        self.bumper_pressed = False
        self._battery_full_v = BATTERY_FULL_V
        self.roll_rad = 0.0
        self.pitch_rad = 0.0

    def battery_gives(self, voltage_v: float, t_s: float) -> None:
        """From now on, less what drains."""
        self._battery_full_v = voltage_v + BATTERY_DROP_V_S * t_s

    def reading(self, t_s: float, stamp_s: float, liquid: Liquid, noise: np.random.Generator) -> InputState:
        n = noise.normal(size=6).tolist()
        gain = self._true.flow_meter_gain
        flow = liquid.flow_ml_s * gain * (1.0 + FLOW_NOISE_SHARE * n[0])
        level = liquid.tank_ml + self._true.level_offset_ml + LEVEL_NOISE_SHARE * self._tank_ml * n[1]
        return InputState(
            stamp_s=stamp_s,
            estop_pressed=self.estop_pressed,
            bumper_pressed=self.bumper_pressed,
            tank_level_ml=max(0.0, level),
            flow_ml_s=flow if flow >= METER_FLOOR_ML_S else 0.0,
            flow_total_ml=math.floor(liquid.total_ml * gain / self._pulse_ml) * self._pulse_ml,
            pressure_bar=max(0.0, liquid.pressure_bar * self._true.pressure_gain + PRESSURE_NOISE_BAR * n[2]),
            roll_rad=self.roll_rad + TILT_NOISE_RAD * n[3],
            pitch_rad=self.pitch_rad + TILT_NOISE_RAD * n[4],
            battery_v=self._battery_full_v - BATTERY_DROP_V_S * t_s + BATTERY_NOISE_V * n[5],
        )

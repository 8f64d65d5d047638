"""What the robot is told about its machine. The twin's true values differ, see ``deviations``."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from datetime import UTC, datetime

import numpy as np
import numpy.typing as npt

from drivers.gps.values import FixQuality
from drivers.relay.values import Channel
from drivers.twin.optics import StereoOptics

Array = npt.NDArray[np.float64]

_SIGNED = {"gps_latitude_deg", "gps_longitude_deg", "gps_altitude_m", "gps_row_heading_rad", "modem_signal_dbm"}
_MAY_BE_ZERO = {"valve_open_s", "valve_close_s", "tank_fill_ml"}


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Nominal:
    """The machine as configured. Raises ``ValueError`` for an impossible value.

    ``base_from_camera`` and ``base_from_arm`` are (4, 4) transforms (left optical frame, URDF root link).
    ``pump_rise_s`` is the time constant of the pressure; ``pump_pressure_bar`` where the relief valve holds it.
    ``gps_row_heading_rad`` is where the row's x points, clockwise from true north; the datum is the row's origin.
    """

    optics: StereoOptics
    base_from_camera: Array
    base_from_arm: Array
    urdf_text: str
    stow_rad: tuple[float, ...]
    joint_velocity_rad_s: float = 1.5
    joint_acceleration_rad_s2: float = 4.0

    nozzle_flow_ml_s: float = 12.6
    nozzle_pressure_bar: float = 2.76
    cone_half_angle_rad: float = math.radians(15.0)
    valve_open_s: float = 0.025
    valve_close_s: float = 0.020
    pump_pressure_bar: float = 2.76
    pump_rise_s: float = 0.6
    tank_ml: float = 10_000.0
    tank_fill_ml: float = 8_000.0
    flow_meter_pulses_per_l: float = 5880.0

    wheel_radius_m: float = 0.10
    track_m: float = 0.50
    max_speed_m_s: float = 0.5
    max_acceleration_m_s2: float = 0.5
    drive_timeout_s: float = 0.5

    channels: frozenset[Channel] = frozenset({Channel.VALVE, Channel.PUMP, Channel.LAMP, Channel.BEACON})
    pulse_quantum_s: float = 0.1
    pulse_max_s: float = 25.5
    relay_round_trip_s: float = 0.017

    arm_round_trip_s: float = 0.002
    drive_round_trip_s: float = 0.004
    inputs_round_trip_s: float = 0.003

    camera_rate_hz: float = 15.0
    camera_readout_s: float = 0.030
    exposure_s: float = 0.004
    gain: float = 1.0
    exposure_min_s: float = 0.0001
    exposure_max_s: float = 0.050
    gain_max: float = 16.0

    gps_latitude_deg: float = 47.6600
    gps_longitude_deg: float = 9.1750
    gps_altitude_m: float = 404.0
    gps_row_heading_rad: float = 0.0
    gps_quality: FixQuality = FixQuality.RTK_FIXED
    gps_rate_hz: float = 5.0
    gps_two_antennas: bool = False

    modem_operator: str = "Demo Mobile"
    modem_signal_dbm: float = -77.0
    start_utc: datetime = datetime(2026, 6, 15, 10, 0, tzinfo=UTC)

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if isinstance(value, bool) or not isinstance(value, int | float):
                continue
            if not math.isfinite(value):
                raise ValueError(f"{field.name}: expected a finite number, found {value}; give a number")
            low_ok = field.name in _SIGNED or value > 0 or (value == 0 and field.name in _MAY_BE_ZERO)
            if not low_ok and not isinstance(value, FixQuality):
                raise ValueError(f"{field.name}: expected a positive number, found {value:g}; correct the value")
        for name in ("base_from_camera", "base_from_arm"):
            _check_transform(name, getattr(self, name))
        if self.tank_fill_ml > self.tank_ml:
            raise ValueError(
                f"tank_fill_ml: expected at most {self.tank_ml:g}, found {self.tank_fill_ml:g}; correct it"
            )
        if not self.exposure_min_s <= self.exposure_s <= self.exposure_max_s:
            raise ValueError(
                f"exposure_s: expected {self.exposure_min_s:g} to {self.exposure_max_s:g}, found {self.exposure_s:g}"
            )
        if self.start_utc.tzinfo is None:
            raise ValueError("start_utc: expected a time with its zone, found one without; add +00:00")


def _check_transform(name: str, matrix: Array) -> None:
    if np.shape(matrix) != (4, 4):
        raise ValueError(f"{name}: expected a (4, 4) transform, found shape {np.shape(matrix)}")
    rotation = matrix[:3, :3]
    if not (np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-6) and np.linalg.det(rotation) > 0):
        raise ValueError(f"{name}: expected a rotation matrix, found determinant {np.linalg.det(rotation):.3g}")

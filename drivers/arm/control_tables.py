"""The control tables of Dynamixel X-series servos (Protocol 2.0) as data: registers, models, units.

Source: ROBOTIS e-Manual, "Control Table of EEPROM Area" and "Control Table of RAM Area" of each model.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum
from types import MappingProxyType

TICKS_PER_TURN = 4096
TICK_RAD = math.tau / TICKS_PER_TURN
VELOCITY_UNIT_RAD_S = 0.229 * math.tau / 60.0
ACCELERATION_UNIT_RAD_S2 = 214.577 * math.tau / 3600.0
WATCHDOG_UNIT_S = 0.020
RETURN_DELAY_UNIT_S = 2e-6
REALTIME_TICK_S = 0.001
REALTIME_TICKS = 32768  # counts from 0 to 32767 and begins anew
VOLTAGE_UNIT_V = 0.1
FIRST_RAM_ADDRESS = 64
TABLE_BYTES = 147 + 1
EXTENDED_TICKS = 1_048_575

BAUDS = (9_600, 57_600, 115_200, 1_000_000, 2_000_000, 3_000_000, 4_000_000, 4_500_000)  # by register value


class OperatingMode(IntEnum):
    """Register 11, as far as positions are concerned."""

    POSITION = 3
    EXTENDED_POSITION = 4


@dataclass(frozen=True, slots=True)
class Register:
    """``initial`` and the range are raw values; EEPROM below address 64. ``reads_only``: the host cannot write it."""

    name: str
    address: int
    size: int
    initial: int = 0
    low: int | None = None
    high: int | None = None
    reads_only: bool = False
    signed: bool = False

    @property
    def in_eeprom(self) -> bool:
        return self.address < FIRST_RAM_ADDRESS

    @property
    def end(self) -> int:
        return self.address + self.size

    def decode(self, data: bytes) -> int:
        return int.from_bytes(data, "little", signed=self.signed)

    def encode(self, value: int) -> bytes:
        """Two's complement, whichever way the value is meant."""
        return (value & ((1 << 8 * self.size) - 1)).to_bytes(self.size, "little")


@dataclass(frozen=True, slots=True)
class Model:
    """A kind of servo. ``effort_at_stall`` is what register 126 (current or load) shows at its stall torque."""

    number: int
    name: str
    stall_n_m: float
    effort_at_stall: int
    registers: Mapping[str, Register]

    def register(self, name: str) -> Register:
        """``KeyError`` when this model has none of that name."""
        return self.registers[name]


def _read(name: str, address: int, size: int, initial: int = 0, *, signed: bool = False) -> Register:
    return Register(name, address, size, initial, reads_only=True, signed=signed)


def _write(name: str, address: int, size: int, initial: int, low: int, high: int) -> Register:
    return Register(name, address, size, initial, low, high, signed=low < 0)


@dataclass(frozen=True, slots=True)
class _Differences:
    """What differs between models beside number, name and torque."""

    temperature_limit: int
    voltage: tuple[int, int]  # range of both limits, 0.1 V
    velocity_limit: int
    current_limit: int | None  # None: the model measures load, not current
    gains: tuple[int, int, int]  # velocity I, position D, position P
    operating_modes: int = 16


_XM = _Differences(80, (95, 160), 200, 1193, (1920, 0, 800))


def _registers(number: int, own: _Differences) -> Mapping[str, Register]:
    low_v, high_v = own.voltage
    velocity_i, position_d, position_p = own.gains
    table = [
        _read("model_number", 0, 2, number),
        _read("model_information", 2, 4),
        _read("firmware_version", 6, 1, 45),
        _write("id", 7, 1, 1, 0, 252),
        _write("baud_rate", 8, 1, 1, 0, 7),
        _write("return_delay_time", 9, 1, 250, 0, 254),
        _write("drive_mode", 10, 1, 0, 0, 13),
        _write("operating_mode", 11, 1, 3, 0, own.operating_modes),
        _write("secondary_id", 12, 1, 255, 0, 255),
        _write("protocol_type", 13, 1, 2, 1, 2),
        _write("homing_offset", 20, 4, 0, -1_044_479, 1_044_479),
        _write("moving_threshold", 24, 4, 10, 0, 1023),
        _write("temperature_limit", 31, 1, own.temperature_limit, 0, 100),
        _write("max_voltage_limit", 32, 2, high_v, low_v, high_v),
        _write("min_voltage_limit", 34, 2, low_v, low_v, high_v),
        _write("pwm_limit", 36, 2, 885, 0, 885),
        _write("velocity_limit", 44, 4, own.velocity_limit, 0, 2047),
        _write("max_position_limit", 48, 4, 4095, 0, 4095),
        _write("min_position_limit", 52, 4, 0, 0, 4095),
        _write("startup_configuration", 60, 1, 0, 0, 3),
        _write("shutdown", 63, 1, 52, 0, 255),
        _write("torque_enable", 64, 1, 0, 0, 1),
        _write("led", 65, 1, 0, 0, 1),
        _write("status_return_level", 68, 1, 2, 0, 2),
        _read("registered_instruction", 69, 1),
        _read("hardware_error_status", 70, 1),
        _write("velocity_i_gain", 76, 2, velocity_i, 0, 16_383),
        _write("velocity_p_gain", 78, 2, 100, 0, 16_383),
        _write("position_d_gain", 80, 2, position_d, 0, 16_383),
        _write("position_i_gain", 82, 2, 0, 0, 16_383),
        _write("position_p_gain", 84, 2, position_p, 0, 16_383),
        _write("feedforward_2nd_gain", 88, 2, 0, 0, 16_383),
        _write("feedforward_1st_gain", 90, 2, 0, 0, 16_383),
        _write("bus_watchdog", 98, 1, 0, -1, 127),
        _write("goal_pwm", 100, 2, 885, -885, 885),
        _write("goal_velocity", 104, 4, 0, -2047, 2047),
        _write("profile_acceleration", 108, 4, 0, 0, 32_767),
        _write("profile_velocity", 112, 4, 0, 0, 32_767),
        _write("goal_position", 116, 4, 0, -EXTENDED_TICKS, EXTENDED_TICKS),
        _read("realtime_tick", 120, 2),
        _read("moving", 122, 1),
        _read("moving_status", 123, 1),
        _read("present_pwm", 124, 2, signed=True),
        _read("present_load" if own.current_limit is None else "present_current", 126, 2, signed=True),
        _read("present_velocity", 128, 4, signed=True),
        _read("present_position", 132, 4, signed=True),
        _read("velocity_trajectory", 136, 4, signed=True),
        _read("position_trajectory", 140, 4, signed=True),
        _read("present_input_voltage", 144, 2),
        _read("present_temperature", 146, 1),
        _read("backup_ready", 147, 1),
    ]
    if own.current_limit is not None:
        table.append(_write("current_limit", 38, 2, own.current_limit, 0, own.current_limit))
        table.append(_write("goal_current", 102, 2, own.current_limit, -own.current_limit, own.current_limit))
    return MappingProxyType({register.name: register for register in sorted(table, key=lambda r: r.address)})


def _model(number: int, name: str, stall_n_m: float, effort_at_stall: int, own: _Differences) -> Model:
    return Model(number, name, stall_n_m, effort_at_stall, _registers(number, own))


def _of_xm(velocity_limit: int, current_limit: int) -> _Differences:
    return _Differences(_XM.temperature_limit, _XM.voltage, velocity_limit, current_limit, _XM.gains)


# Stall torque at 12 V (XL330: 5 V); the effort there is its current in 2.69 mA (XL330: 1 mA), or a load of 1000.
_ALL = (
    _model(1060, "XL430-W250", 1.5, 1000, _Differences(72, (60, 140), 265, None, (1000, 4000, 640))),
    _model(1020, "XM430-W350", 4.1, 855, _of_xm(200, 1193)),
    _model(1030, "XM430-W210", 3.0, 855, _of_xm(330, 1193)),
    _model(1120, "XM540-W270", 10.6, 1636, _of_xm(128, 2047)),
    _model(1130, "XM540-W150", 7.3, 1636, _of_xm(230, 2047)),
    _model(1190, "XL330-M077", 0.228, 1470, _Differences(70, (31, 70), 1620, 1750, (1600, 0, 400))),
    _model(1200, "XL330-M288", 0.52, 1470, _Differences(70, (31, 70), 445, 1750, (1600, 0, 400))),
)
MODELS: Mapping[str, Model] = MappingProxyType({model.name: model for model in _ALL})
MODEL_NAMES: Mapping[int, str] = MappingProxyType({model.number: model.name for model in _ALL})

HARDWARE_ERRORS: Mapping[int, str] = MappingProxyType({
    0: "input voltage", 2: "overheating", 3: "motor encoder", 4: "electrical shock", 5: "overload",
})  # fmt: skip


def hardware_error_text(byte: int) -> str:
    """What a hardware error byte (register 70) says."""
    names = [HARDWARE_ERRORS.get(bit, f"bit {bit}") for bit in range(8) if byte >> bit & 1]
    return f"0x{byte:02x} ({', '.join(names)})" if names else "none"


def model_text(number: int) -> str:
    return MODEL_NAMES.get(number, f"unknown model {number}")

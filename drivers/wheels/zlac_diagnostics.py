"""What a ZLAC8015D tells of itself."""

from __future__ import annotations

from dataclasses import dataclass

from drivers.modbus_master import ModbusUnit
from drivers.wheels import zlac_registers as r
from drivers.wheels.zlac_settings import Zlac8015dSettings
from drivers.wheels.zlac_talk import persist

_STATES = {
    0: "released",
    r.Status.LOCKED: "enabled",
    r.Status.EMERGENCY_STOP: "emergency stop",
    r.Status.ALARM: "alarm",
}


@dataclass(frozen=True, slots=True)
class MotorDiagnostics:
    """One wheel's motor. ``state``: released, enabled, emergency stop or alarm; ``counts_per_turn`` by its encoder."""

    state: str
    turning: bool
    temperature_c: float
    current_a: float
    faults: tuple[str, ...]
    counts_per_turn: int


@dataclass(frozen=True, slots=True)
class Zlac8015dDiagnostics:
    software: int
    battery_v: float
    controller_temperature_c: float
    left: MotorDiagnostics
    right: MotorDiagnostics


def diagnose(unit: ModbusUnit, settings: Zlac8015dSettings) -> Zlac8015dDiagnostics:
    """In the owner thread of the port. ``DeviceTimeout``, ``DeviceFault``."""
    words = persist(lambda: unit.read_holding(r.FIRST_READING, r.READING_WORDS))
    left_lines = persist(lambda: unit.read_holding(r.LEFT_ENCODER_LINES.address, 1))[0]
    right_lines = persist(lambda: unit.read_holding(r.RIGHT_ENCODER_LINES.address, 1))[0]

    def told(register: r.Register) -> int:
        return words[register.address - r.FIRST_READING]

    left = _motor(
        told(r.STATUS) >> 8, told(r.MOTOR_TEMPERATURES) >> 8, told(r.LEFT_CURRENT), told(r.LEFT_FAULTS), left_lines
    )
    right = _motor(
        told(r.STATUS) & 0xFF,
        told(r.MOTOR_TEMPERATURES) & 0xFF,
        told(r.RIGHT_CURRENT),
        told(r.RIGHT_FAULTS),
        right_lines,
    )
    return Zlac8015dDiagnostics(
        software=told(r.SOFTWARE),
        battery_v=0.01 * told(r.BUS_VOLTAGE),
        controller_temperature_c=0.1 * r.signed_16(told(r.DRIVER_TEMPERATURE)),
        left=right if settings.swapped else left,
        right=left if settings.swapped else right,
    )


def _motor(status: int, temperature: int, current: int, faults: int, lines: int) -> MotorDiagnostics:
    return MotorDiagnostics(
        state=_STATES[status & r.Status.ALARM],
        turning=bool(status & r.Status.RUNNING),
        temperature_c=temperature - 256.0 if temperature & 0x80 else float(temperature),
        current_a=0.1 * r.signed_16(current),
        faults=tuple(fault.name for fault in r.faults_in(faults)),
        counts_per_turn=r.COUNTS_A_LINE * lines,
    )

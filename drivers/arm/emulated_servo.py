"""One emulated servo: its register file, what may be written when, its clock and its watchdog."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from drivers.arm.control_tables import (
    BAUDS,
    EXTENDED_TICKS,
    REALTIME_TICK_S,
    REALTIME_TICKS,
    RETURN_DELAY_UNIT_S,
    TABLE_BYTES,
    WATCHDOG_UNIT_S,
    Model,
    OperatingMode,
    Register,
)
from drivers.arm.protocol2 import ALERT, StatusError

BOOT_S = 0.25
FIRMWARE = 46
AMBIENT_C, HEATING_C, THERMAL_S = 25.0, 30.0, 300.0  # of the windings: at rest, more at full torque, time constant
GOALS = frozenset({"goal_pwm", "goal_current", "goal_velocity", "goal_position"})
_LIMITS = {"goal_pwm": "pwm_limit", "goal_current": "current_limit", "goal_velocity": "velocity_limit"}
TRIPPED = -1
CLEAR_MULTI_TURN = b"\x01\x44\x58\x4c\x22"


class Refused(Exception):
    """The servo answers with this error."""

    def __init__(self, error: StatusError) -> None:
        super().__init__(error.name)
        self.error = error


@dataclass(frozen=True, slots=True)
class Sensed:
    """What the servo's sensors and its trajectory generator show at a moment; raw values."""

    effort: int
    velocity: int
    position: int
    velocity_trajectory: int
    position_trajectory: int
    load: float  # fraction of the stall torque


class EmulatedServo:
    """``joint`` is the index of the joint it turns. Times are in the emulator's clock.

    ``dead``: without power on its electronics, it hears and says nothing. Changes of register that the machine must
    follow are left in ``changed`` until taken.
    """

    def __init__(self, servo_id: int, model: Model, joint: int, now_s: float) -> None:
        self.model, self.joint = model, joint
        self.dead = False
        self.changed: set[str] = set()
        self._table = bytearray(TABLE_BYTES)
        self._at: dict[int, Register] = {register.address: register for register in model.registers.values()}
        self._pending: tuple[int, bytes] | None = None
        self._fed_s = self._booted_s = self._warmed_s = now_s
        self._ready_s = -math.inf
        self._temperature_c = AMBIENT_C
        for register in model.registers.values():
            self.set(register.name, register.initial)
        self.set("id", servo_id)
        self.set("firmware_version", FIRMWARE)

    # --- registers, as the servo itself sees them

    def get(self, name: str) -> int:
        register = self.model.registers[name]
        return register.decode(bytes(self._table[register.address : register.end]))

    def set(self, name: str, value: int) -> None:
        register = self.model.registers[name]
        self._table[register.address : register.end] = register.encode(value)

    @property
    def servo_id(self) -> int:
        return self.get("id")

    @property
    def baud(self) -> int:
        return BAUDS[self.get("baud_rate")]

    @property
    def torque_on(self) -> bool:
        return bool(self._table[64])

    @property
    def alert(self) -> int:
        return ALERT if self._table[70] else 0

    @property
    def return_delay_s(self) -> float:
        return self._table[9] * RETURN_DELAY_UNIT_S

    @property
    def answers_level(self) -> int:
        """Status Return Level: 0 only to a ping, 1 to reads too, 2 to all."""
        return self._table[68]

    @property
    def reversed(self) -> bool:
        return bool(self._table[10] & 1)

    def hears(self, now_s: float, host_baud: int | None) -> bool:
        return not self.dead and now_s >= self._ready_s and (host_baud is None or host_baud == self.baud)

    # --- its watchdog

    def feed(self, now_s: float) -> None:
        """An instruction came that concerns it."""
        self._fed_s = now_s

    @property
    def trips_at_s(self) -> float:
        """When its watchdog stops it unless it hears something."""
        units = self.get("bus_watchdog")
        return self._fed_s + units * WATCHDOG_UNIT_S if units > 0 and self.torque_on else math.inf

    def trip(self) -> None:
        self.set("bus_watchdog", TRIPPED)

    # --- what the host does

    def read(self, address: int, size: int) -> bytes:
        """Unused addresses read as 0. ``Refused`` beyond the table."""
        if size < 1 or address + size > TABLE_BYTES:
            raise Refused(StatusError.ACCESS)
        return bytes(self._table[address : address + size])

    def sense(self, now_s: float, sensed: Sensed) -> None:
        """Bring the registers that show the present up to date."""
        share = 1.0 - math.exp(-max(0.0, now_s - self._warmed_s) / THERMAL_S)
        self._temperature_c += share * (AMBIENT_C + HEATING_C * sensed.load**2 - self._temperature_c)
        self._warmed_s = now_s
        supply = 50 if self.model.name.startswith("XL330") else 120
        self.set("realtime_tick", int((now_s - self._booted_s) / REALTIME_TICK_S) % REALTIME_TICKS)
        self.set("moving", abs(sensed.velocity) > self.get("moving_threshold"))
        self.set("present_pwm", round(885 * sensed.load))
        self.set("present_current" if "present_current" in self.model.registers else "present_load", sensed.effort)
        self.set("present_velocity", sensed.velocity)
        self.set("present_position", sensed.position)
        self.set("velocity_trajectory", sensed.velocity_trajectory)
        self.set("position_trajectory", sensed.position_trajectory)
        self.set("present_input_voltage", supply - round(4 * abs(sensed.load)))
        self.set("present_temperature", round(self._temperature_c))

    def write(self, address: int, data: bytes) -> None:
        """All of it or, with ``Refused``, nothing."""
        values = self._taken_apart(address, data)
        for register, value in values:
            self._require_writable(register, value, values)
        for register, value in values:
            self._obey(register.name, value)

    def _taken_apart(self, address: int, data: bytes) -> list[tuple[Register, int]]:
        """Whole registers without a gap."""
        values, end = [], address + len(data)
        if not data:
            raise Refused(StatusError.DATA_LENGTH)
        while address < end:
            register = self._at.get(address)
            if register is None:
                raise Refused(StatusError.ACCESS)
            if register.end > end:
                raise Refused(StatusError.DATA_LENGTH)
            values.append((register, register.decode(data[: register.size])))
            address, data = register.end, data[register.size :]
        return values

    def _require_writable(self, register: Register, value: int, whole: Sequence[tuple[Register, int]]) -> None:
        if register.reads_only or (register.in_eeprom and self.torque_on):
            raise Refused(StatusError.ACCESS)
        if register.name in GOALS and self.get("bus_watchdog") == TRIPPED:
            raise Refused(StatusError.DATA_RANGE)
        if register.name == "torque_enable" and value == 1 and self._table[70]:
            raise Refused(StatusError.ACCESS)
        low, high = register.low, register.high
        if register.name == "goal_position" and self.get("operating_mode") == OperatingMode.EXTENDED_POSITION:
            low, high = -EXTENDED_TICKS, EXTENDED_TICKS
        elif register.name == "goal_position":
            if not self.get("min_position_limit") <= value <= self.get("max_position_limit"):
                raise Refused(StatusError.DATA_LIMIT)
        elif register.name in _LIMITS and abs(value) > self.get(_LIMITS[register.name]):
            raise Refused(StatusError.DATA_LIMIT)
        if (low is not None and value < low) or (high is not None and value > high):
            raise Refused(StatusError.DATA_RANGE)
        if register.name == "operating_mode" and value not in (0, 1, 3, 4, 5, 16):
            raise Refused(StatusError.DATA_RANGE)

    def _obey(self, name: str, value: int) -> None:
        self.set(name, value)
        if name == "operating_mode":
            for reset in ("profile_acceleration", "profile_velocity"):
                self.set(reset, 0)
        if name in ("torque_enable", "goal_position"):
            self.changed.add(name)

    def keep_for_action(self, address: int, data: bytes) -> None:
        """A write for later."""
        values = self._taken_apart(address, data)
        for register, value in values:
            self._require_writable(register, value, values)
        self._pending = (address, data)
        self.set("registered_instruction", 1)

    def act(self) -> None:
        """Do the write that was kept, if there is one."""
        pending, self._pending = self._pending, None
        self.set("registered_instruction", 0)
        if pending is not None:
            self.write(*pending)

    def reboot(self, now_s: float) -> None:
        """RAM registers and torque are lost; it hears again after ``BOOT_S``."""
        for register in self.model.registers.values():
            if not register.in_eeprom:
                self.set(register.name, register.initial)
        self._pending = None
        self._booted_s, self._ready_s = now_s, now_s + BOOT_S
        self.changed |= {"torque_enable", "rebooted"}

    def factory_reset(self, option: int, now_s: float) -> None:
        """Option 0xFF: all; 1: all but the id; 2: all but id and baud rate."""
        if self.torque_on:
            raise Refused(StatusError.ACCESS)
        if option not in (0x01, 0x02, 0xFF):
            raise Refused(StatusError.DATA_RANGE)
        kept = {0x01: ("id",), 0x02: ("id", "baud_rate"), 0xFF: ()}[option]
        for register in self.model.registers.values():
            if register.in_eeprom and register.name not in (*kept, "firmware_version"):
                self.set(register.name, register.initial)
        self.reboot(now_s)

    def clear(self, data: bytes) -> None:
        """Clear Multi-Turn: a joint never turns twice here, so there is nothing to forget."""
        if data != CLEAR_MULTI_TURN:
            raise Refused(StatusError.DATA_RANGE)
        if self.get("moving"):
            raise Refused(StatusError.RESULT_FAIL)

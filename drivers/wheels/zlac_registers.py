"""The holding registers of the ZLAC8015D as data: addresses, ranges, units, states and faults.

Sources: ZLAC8015D RS485 communication manual as the public drivers of rasheeddo, Msfjel383 and MaSiRo-Project give it.
Registers are read by function 03 and written by 06 and 16; 32-bit values stand in two registers, the high word first.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum, IntFlag


@dataclass(frozen=True, slots=True)
class Register:
    """One 16-bit register. ``writable`` within ``low`` to ``high`` (signed where ``low`` is negative)."""

    address: int
    name: str
    writable: bool = False
    low: int = 0
    high: int = 0xFFFF
    at_power_on: int = 0


OFFLINE_TIME = Register(0x2000, "communication offline time, ms, 0 = never", True, 0, 0x7FFF)
UNIT_ID = Register(0x2001, "RS485 unit id", True, 1, 127, 1)
BAUD_CODE = Register(0x2002, "RS485 baud rate by its code", True, 1, 6, 2)
MAX_SPEED = Register(0x2008, "highest motor speed, rpm", True, 1, 1000, 1000)
MODE = Register(0x200D, "mode of operation", True, 0, 4)
CONTROL = Register(0x200E, "control word", True, 0, 0x12)
LEFT_ENCODER_LINES = Register(0x2030, "encoder lines a turn, left", True, 0, 4096, 1024)
RIGHT_ENCODER_LINES = Register(0x2060, "encoder lines a turn, right", True, 0, 4096, 1024)
LEFT_RISE = Register(0x2080, "acceleration time, left, ms", True, 0, 0x7FFF, 500)
RIGHT_RISE = Register(0x2081, "acceleration time, right, ms", True, 0, 0x7FFF, 500)
LEFT_FALL = Register(0x2082, "deceleration time, left, ms", True, 0, 0x7FFF, 500)
RIGHT_FALL = Register(0x2083, "deceleration time, right, ms", True, 0, 0x7FFF, 500)
LEFT_TARGET = Register(0x2088, "wanted speed, left, rpm", True, -3000, 3000)
RIGHT_TARGET = Register(0x2089, "wanted speed, right, rpm", True, -3000, 3000)
SOFTWARE = Register(0x20A0, "software version")
BUS_VOLTAGE = Register(0x20A1, "supply voltage, 0.01 V")
STATUS = Register(0x20A2, "status, left in the high byte, right in the low one")
HALLS = Register(0x20A3, "Hall inputs, left in the high byte, right in the low one")
MOTOR_TEMPERATURES = Register(0x20A4, "motor temperature, degrees C, left in the high byte, right in the low one")
LEFT_FAULTS = Register(0x20A5, "faults, left")
RIGHT_FAULTS = Register(0x20A6, "faults, right")
LEFT_POSITION_HIGH = Register(0x20A7, "position, left, counts, high word")
LEFT_POSITION_LOW = Register(0x20A8, "position, left, counts, low word")
RIGHT_POSITION_HIGH = Register(0x20A9, "position, right, counts, high word")
RIGHT_POSITION_LOW = Register(0x20AA, "position, right, counts, low word")
LEFT_SPEED = Register(0x20AB, "speed, left, 0.1 rpm, signed")
RIGHT_SPEED = Register(0x20AC, "speed, right, 0.1 rpm, signed")
LEFT_CURRENT = Register(0x20AD, "motor current, left, 0.1 A, signed")
RIGHT_CURRENT = Register(0x20AE, "motor current, right, 0.1 A, signed")
CONNECTED = Register(0x20AF, "tuning software connected")
DRIVER_TEMPERATURE = Register(0x20B0, "controller temperature, 0.1 degrees C, signed")

REGISTERS = {
    register.address: register
    for register in (
        OFFLINE_TIME, UNIT_ID, BAUD_CODE, MAX_SPEED, MODE, CONTROL, LEFT_ENCODER_LINES, RIGHT_ENCODER_LINES,
        LEFT_RISE, RIGHT_RISE, LEFT_FALL, RIGHT_FALL, LEFT_TARGET, RIGHT_TARGET,
        SOFTWARE, BUS_VOLTAGE, STATUS, HALLS, MOTOR_TEMPERATURES, LEFT_FAULTS, RIGHT_FAULTS,
        LEFT_POSITION_HIGH, LEFT_POSITION_LOW, RIGHT_POSITION_HIGH, RIGHT_POSITION_LOW, LEFT_SPEED, RIGHT_SPEED,
        LEFT_CURRENT, RIGHT_CURRENT, CONNECTED, DRIVER_TEMPERATURE,
    )
}  # fmt: skip

VELOCITY_MODE = 3
COUNTS_A_LINE = 4

FIRST_READING, READING_WORDS = SOFTWARE.address, DRIVER_TEMPERATURE.address - SOFTWARE.address + 1
FIRST_ODOMETRY, ODOMETRY_WORDS = LEFT_FAULTS.address, RIGHT_SPEED.address - LEFT_FAULTS.address + 1


class Control(IntEnum):
    """What the control word commands."""

    EMERGENCY_STOP = 5
    CLEAR_ALARM = 6
    DISABLE = 7
    ENABLE = 8


class Status(IntFlag):
    """One wheel's byte of the status word; both of LOCKED and EMERGENCY_STOP together say alarm."""

    RUNNING = 0x01
    LOCKED = 0x40
    EMERGENCY_STOP = 0x80
    ALARM = 0xC0


@dataclass(frozen=True, slots=True)
class Fault:
    """One bit of a wheel's fault word."""

    bit: int
    name: str
    remedy: str


FAULTS = (
    Fault(0x0001, "over-voltage", "check the supply; long braking needs a brake resistor"),
    Fault(0x0002, "under-voltage", "charge the battery and check its terminals and fuse"),
    Fault(0x0004, "over-current", "look for a blocked wheel and a loose or shorted motor cable"),
    Fault(0x0008, "overload", "look for a blocked wheel, too heavy a load, a wrong motor setting"),
    Fault(0x0010, "current out of tolerance", "check the motor cable"),
    Fault(0x0020, "encoder out of tolerance", "look for a blocked wheel; check the encoder cable"),
    Fault(0x0040, "speed out of tolerance", "look for a blocked or dragging wheel"),
    Fault(0x0080, "reference voltage", "have the controller repaired"),
    Fault(0x0100, "EEPROM", "restore the controller's factory settings, then set it up again"),
    Fault(0x0200, "Hall sensor", "check the motor's signal cable and plug"),
    Fault(0x0400, "motor over-temperature", "let the motor cool; lighten its load"),
    Fault(0x0800, "encoder", "check the encoder cable and plug"),
    Fault(0x1000, "encoder cable", "check the encoder cable and plug"),
    Fault(0x2000, "speed setting", "the wanted speed exceeds the motor's rated speed: lower max_speed_m_s"),
)


def faults_in(word: int) -> tuple[Fault, ...]:
    """The faults of a wheel's fault word; a bit that no list names is one too."""
    named = tuple(fault for fault in FAULTS if word & fault.bit)
    rest = word & ~sum(fault.bit for fault in named)
    if not rest:
        return named
    return (*named, Fault(rest, f"unknown fault 0x{rest:04X}", "look the fault code up in the controller's manual"))


def signed_16(word: int) -> int:
    return word - 0x10000 if word & 0x8000 else word


def signed_32(high: int, low: int) -> int:
    value = high << 16 | low
    return value - 0x1_0000_0000 if value & 0x8000_0000 else value


def word_of(value: int) -> int:
    """A signed 16-bit value as a register holds it. ``ValueError`` beyond."""
    if not -0x8000 <= value <= 0x7FFF:
        raise ValueError(f"expected a 16-bit value, found {value}")
    return value & 0xFFFF


def words_of(value: int) -> tuple[int, int]:
    """A 32-bit counter, wrapped as a counter wraps, as high and low word."""
    return value >> 16 & 0xFFFF, value & 0xFFFF

"""Neighbouring registers that are read together; all X-series models have them at the same addresses."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import ClassVar

MOTION_ADDRESS, MOTION_BYTES = 126, 10
_MOTION = struct.Struct("<hii")
HEALTH_ADDRESS, HEALTH_BYTES = 64, 35
CLIMATE_ADDRESS, CLIMATE_BYTES = 120, 27
STOPPING_ADDRESS, STOPPING_BYTES = 116, 28
_STOPPING = struct.Struct("<i8xiiii")
GOAL_ADDRESS, GOAL_BYTES = 116, 4
PROFILE_ADDRESS = 108
TORQUE_ADDRESS = 64
WATCHDOG_ADDRESS = 98
POSITION_ADDRESS, POSITION_BYTES = 132, 4
WATCHDOG_TRIPPED = 0xFF


@dataclass(frozen=True, slots=True)
class Motion:
    """Registers 126 to 135: current or load, velocity, position; raw."""

    effort: int
    velocity: int
    position: int

    @classmethod
    def of(cls, data: bytes) -> Motion:
        return cls(*_MOTION.unpack(data))


@dataclass(frozen=True, slots=True)
class Stopping:
    """Registers 116 to 143 as far as they matter for stopping; raw."""

    goal: int
    velocity: int
    position: int
    velocity_trajectory: int
    position_trajectory: int
    layout: ClassVar[struct.Struct] = _STOPPING

    @classmethod
    def of(cls, data: bytes) -> Stopping:
        return cls(*cls.layout.unpack(data))


@dataclass(frozen=True, slots=True)
class Condition:
    """Registers 64 to 98 as far as they tell whether the servo works."""

    torque_on: bool
    hardware_error: int
    watchdog: int

    @classmethod
    def of(cls, data: bytes) -> Condition:
        return cls(bool(data[0]), data[70 - HEALTH_ADDRESS], data[WATCHDOG_ADDRESS - HEALTH_ADDRESS])


@dataclass(frozen=True, slots=True)
class Climate:
    """Registers 120 to 146 as far as they tell how the servo fares."""

    tick: int
    voltage: int
    temperature: int

    @classmethod
    def of(cls, data: bytes) -> Climate:
        return cls(
            int.from_bytes(data[0:2], "little"),
            int.from_bytes(data[144 - CLIMATE_ADDRESS : 146 - CLIMATE_ADDRESS], "little"),
            data[146 - CLIMATE_ADDRESS],
        )


def int32(value: int) -> bytes:
    return (value & 0xFFFFFFFF).to_bytes(4, "little")

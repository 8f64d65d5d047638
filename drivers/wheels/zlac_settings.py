"""What is configured of a ZLAC8015D, and what its registers are set to for it."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

from drivers.wheels.drive_geometry import Mounting, count_m, ramp_ms, rpm_of, speed_of
from drivers.wheels.zlac_registers import LEFT_RISE, MAX_SPEED, OFFLINE_TIME

BRAKING_FACTOR = 2.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Zlac8015dSettings:
    """A differential drive of two hub motors. Raises ``ValueError`` for what the controller cannot keep.

    ``max_deceleration_m_s2``: how fast commanded speeds fall, and how a stop brakes; None is twice the acceleration.
    ``counts_per_turn``: encoder counts of one turn, four a line. ``command_timeout_s``: silence after which the
    controller stops the base by itself. Speeds and accelerations are of a wheel's rim.
    """

    radius_m: float
    track_m: float
    max_speed_m_s: float
    max_acceleration_m_s2: float
    max_deceleration_m_s2: float | None = None
    unit_id: int = 1
    counts_per_turn: int = 4096
    command_timeout_s: float = 0.5
    left_mirrored: bool = False
    right_mirrored: bool = True
    swapped: bool = False

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if value is None or isinstance(value, bool):
                continue
            if not (math.isfinite(value) and value > 0):
                raise ValueError(f"wheels: expected {field.name} above 0, found {value}; correct it")
        _within("max_speed_m_s", self.max_rpm, MAX_SPEED.high, "rpm of the wheel")
        _within("command_timeout_s", self.timeout_ms, OFFLINE_TIME.high, "ms")
        for name, time_ms in (("acceleration", self.rise_ms), ("deceleration", self.fall_ms)):
            _within(f"max_speed_m_s / max_{name}_m_s2", time_ms, LEFT_RISE.high, "ms")

    @property
    def mounting(self) -> Mounting:
        return Mounting(self.left_mirrored, self.right_mirrored, self.swapped)

    @property
    def max_rpm(self) -> int:
        """The highest speed as the controller is told it."""
        return math.ceil(rpm_of(self.max_speed_m_s, self.radius_m) - 1e-9)

    @property
    def rise_ms(self) -> int:
        """How long the wheel takes from rest to ``max_rpm``."""
        return ramp_ms(speed_of(self.max_rpm, self.radius_m), self.max_acceleration_m_s2)

    @property
    def deceleration_m_s2(self) -> float:
        return self.max_deceleration_m_s2 or BRAKING_FACTOR * self.max_acceleration_m_s2

    @property
    def fall_ms(self) -> int:
        """How long the wheel takes from ``max_rpm`` to rest."""
        return ramp_ms(speed_of(self.max_rpm, self.radius_m), self.deceleration_m_s2)

    @property
    def timeout_ms(self) -> int:
        return round(1000.0 * self.command_timeout_s)

    @property
    def count_m(self) -> float:
        """How far a wheel rolls for one count."""
        return count_m(self.radius_m, self.counts_per_turn)


def _within(name: str, value: int, highest: int, unit: str) -> None:
    if not 1 <= value <= highest:
        raise ValueError(f"wheels: expected {name} to come to 1 to {highest} {unit}, found {value}; correct it")

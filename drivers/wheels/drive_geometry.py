"""Between the motion of the base and the turning of its two wheels."""

from __future__ import annotations

import math
from dataclasses import dataclass

COUNTER_SPAN = 1 << 32


@dataclass(frozen=True, slots=True)
class WheelPair:
    """A value of the left and of the right wheel, forward positive."""

    left: float
    right: float


@dataclass(frozen=True, slots=True)
class Mounting:
    """How the motors sit: a mirrored one turns backwards where its wheel rolls forward.

    ``swapped``: the controller's left channel drives the right wheel.
    """

    left_mirrored: bool = False
    right_mirrored: bool = True
    swapped: bool = False

    def channels(self, wheels: WheelPair) -> WheelPair:
        """What the controller's left and right channel have for these wheels."""
        left = -wheels.left if self.left_mirrored else wheels.left
        right = -wheels.right if self.right_mirrored else wheels.right
        return WheelPair(right, left) if self.swapped else WheelPair(left, right)

    def wheels(self, channels: WheelPair) -> WheelPair:
        """The inverse of ``channels``."""
        left, right = channels.left, channels.right
        if self.swapped:
            left, right = right, left
        return WheelPair(-left if self.left_mirrored else left, -right if self.right_mirrored else right)


def wheel_speeds(speed_m_s: float, yaw_rate_rad_s: float, track_m: float, max_speed_m_s: float) -> WheelPair:
    """Speeds over ground (m/s); beyond ``max_speed_m_s`` both are scaled down, so that the curve stays the same."""
    turn_m_s = 0.5 * yaw_rate_rad_s * track_m
    left, right = speed_m_s - turn_m_s, speed_m_s + turn_m_s
    scale = min(1.0, max_speed_m_s / max(abs(left), abs(right), 1e-9))
    return WheelPair(left * scale, right * scale)


def base_motion(speeds_m_s: WheelPair, track_m: float) -> tuple[float, float]:
    """Speed forward (m/s) and rate of turn to the left (rad/s)."""
    left, right = speeds_m_s.left, speeds_m_s.right
    return 0.5 * (left + right), (right - left) / track_m


def rpm_of(speed_m_s: float, radius_m: float) -> float:
    return speed_m_s * 60.0 / (math.tau * radius_m)


def speed_of(rpm: float, radius_m: float) -> float:
    """Metres a second."""
    return rpm * math.tau * radius_m / 60.0


def count_m(radius_m: float, counts_per_turn: int) -> float:
    """How far a wheel rolls for one count."""
    return math.tau * radius_m / counts_per_turn


def ramp_ms(speed_m_s: float, acceleration_m_s2: float) -> int:
    """How long a change by ``speed_m_s`` takes, in whole milliseconds, never faster than wanted."""
    return math.ceil(1000.0 * speed_m_s / acceleration_m_s2 - 1e-9)


class LongCount:
    """A 32-bit counter followed beyond its wrap: the count goes on where the register starts over.

    A counter that is set back to 0 (power cycle) shows as it is. Changes of 2**31 and more between two readings cannot
    be told from their complement.
    """

    def __init__(self, raw: int) -> None:
        self.value = raw

    def follow(self, raw: int) -> int:
        """The count, given what the register shows."""
        step = (raw - self.value) % COUNTER_SPAN
        self.value += step - COUNTER_SPAN if step >= COUNTER_SPAN // 2 else step
        return self.value

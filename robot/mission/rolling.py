"""Proof that the wheels turn while they are driven."""

from __future__ import annotations

from drivers.errors import DeviceFault
from drivers.wheels.values import Odometry

LEAST_M, WITHIN_S = 0.001, 0.6


class RollingWatch:
    """Told of every reading while the base is driven. ``DeviceFault`` when the counters stand still."""

    def __init__(self) -> None:
        self._moved: Odometry | None = None

    def check(self, reading: Odometry, commanded_m_s: float) -> None:
        """``commanded_m_s`` is the speed that was asked for since the last reading; at 0 nothing is expected."""
        before = self._moved
        if before is None or commanded_m_s == 0.0 or _travel_m(before, reading) >= LEAST_M:
            self._moved = reading
        elif reading.stamp_s - before.stamp_s > WITHIN_S:
            raise DeviceFault(
                "wheels",
                f"counters that move while {commanded_m_s:.2f} m/s are commanded",
                f"no change in {reading.stamp_s - before.stamp_s:.1f} s",
                "look for a blocked wheel, a motor without power or a dead encoder",
            )


def _travel_m(one: Odometry, other: Odometry) -> float:
    return max(abs(other.left_m - one.left_m), abs(other.right_m - one.right_m))

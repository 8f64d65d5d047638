"""What the drive takes and gives."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Odometry:
    """Wheel travel as the motor controller counts it, by the nominal wheel radius.

    ``left_m`` and ``right_m`` are distances rolled since the controller was powered (they go on over a restart of
    the host); speeds are the present ones; ``stamp_s`` is loop time.
    """

    stamp_s: float
    left_m: float
    right_m: float
    left_m_s: float
    right_m_s: float

    @property
    def speed_m_s(self) -> float:
        return 0.5 * (self.left_m_s + self.right_m_s)

"""What an arm takes and gives. Angles in radians, one entry a joint from the base outwards."""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class ArmState:
    """One reading of every joint at ``stamp_s`` (loop time).

    ``load`` is the fraction of the stall torque (-1..1); ``hardware_error`` is each servo's error byte (0 = none).
    """

    stamp_s: float
    position_rad: tuple[float, ...]
    velocity_rad_s: tuple[float, ...]
    load: tuple[float, ...]
    torque_on: bool
    hardware_error: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class JointTrajectory:
    """Way points of all joints, time-synchronised.

    ``times_s`` rises from 0; ``positions_rad[k]`` are the joint angles at ``times_s[k]``; between way points the
    angles are interpolated linearly, so the sampling must be fine enough for the motion (20 ms or less).
    """

    times_s: tuple[float, ...]
    positions_rad: tuple[tuple[float, ...], ...]

    def __post_init__(self) -> None:
        if len(self.times_s) != len(self.positions_rad) or not self.times_s:
            raise ValueError("a trajectory needs as many times as positions, and at least one")
        if self.times_s[0] != 0.0 or any(b <= a for a, b in zip(self.times_s, self.times_s[1:], strict=False)):
            raise ValueError("trajectory times must start at 0 and rise")

    @property
    def duration_s(self) -> float:
        return self.times_s[-1]

    @property
    def goal_rad(self) -> tuple[float, ...]:
        return self.positions_rad[-1]

    def at(self, time_s: float) -> tuple[float, ...]:
        """Joint angles at a time of the trajectory, the last way point after its end."""
        k = bisect_right(self.times_s, time_s)
        if k == len(self.times_s):
            return self.goal_rad
        (begin_s, end_s), (begin, end) = self.times_s[k - 1 : k + 1], self.positions_rad[k - 1 : k + 1]
        share = (time_s - begin_s) / (end_s - begin_s)
        return tuple(a + share * (b - a) for a, b in zip(begin, end, strict=True))

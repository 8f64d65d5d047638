"""The contract of a differential drive."""

from __future__ import annotations

from typing import Protocol

from drivers.stop_lane import StopLane
from drivers.wheels.values import Odometry


class Wheels(Protocol):
    """A differential drive that stops by itself when commands cease.

    Every method raises a ``DeviceError``; every wait ends in ``DeviceTimeout``.
    """

    @property
    def stop_lane(self) -> StopLane | None:
        """The stop from any thread; None for a simulated device, which belongs to the event loop with its machine."""
        ...

    @property
    def track_m(self) -> float:
        """Distance between the wheels, metres."""
        ...

    @property
    def command_timeout_s(self) -> float:
        """The controller stops the base when no command came for this long."""
        ...

    async def open(self) -> None: ...

    async def close(self) -> None: ...

    async def drive(self, speed_m_s: float, yaw_rate_rad_s: float) -> None:
        """Speed forward and rate of turn to the left; must be renewed within ``command_timeout_s``."""
        ...

    async def stop(self) -> None:
        """Brake to standstill."""
        ...

    async def odometry(self) -> Odometry: ...

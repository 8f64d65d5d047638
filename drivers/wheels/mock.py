"""A differential drive on the twin."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

from drivers.errors import DeviceRefused
from drivers.twin.bus import Bus
from drivers.twin.commands import WheelsDrive, WheelsStop
from drivers.twin.machine import Twin
from drivers.wheels.values import Odometry

TIMEOUT_S = 0.1
WRONG_SCALE = 1.05


class MockWheels:
    """Implements ``drivers.wheels.interface.Wheels``; ``clock`` gives loop time."""

    stop_lane = None

    def __init__(self, twin: Twin, clock: Callable[[], float]) -> None:
        self._twin, self._clock = twin, clock
        self._bus = Bus(twin, clock, "wheels", twin.nominal.drive_round_trip_s, TIMEOUT_S)

    @property
    def track_m(self) -> float:
        return self._twin.nominal.track_m

    @property
    def command_timeout_s(self) -> float:
        return self._twin.nominal.drive_timeout_s

    async def open(self) -> None:
        await self._bus.connect()

    async def close(self) -> None:
        try:
            await self.stop()
        finally:
            self._bus.disconnect()

    async def drive(self, speed_m_s: float, yaw_rate_rad_s: float) -> None:
        if not (math.isfinite(speed_m_s) and math.isfinite(yaw_rate_rad_s)):
            raise DeviceRefused(
                "wheels", "finite speeds", f"{speed_m_s} m/s and {yaw_rate_rad_s} rad/s", "command 0 to stand still"
            )
        command = WheelsDrive(speed_m_s, yaw_rate_rad_s)
        await self._bus.exchange(lambda: None, lambda _at_s: self._twin.apply(self._clock(), command))

    async def stop(self) -> None:
        await self._bus.exchange(lambda: None, lambda _at_s: self._twin.apply(self._clock(), WheelsStop()))

    async def odometry(self) -> Odometry:
        odometry = await self._bus.exchange(lambda: self._twin.odometry(self._clock()))
        return self._bus.seen(odometry, _scaled)


def _scaled(odometry: Odometry) -> Odometry:
    return replace(odometry, left_m=odometry.left_m * WRONG_SCALE, right_m=odometry.right_m * WRONG_SCALE)

"""Runs a test on the production drive and its emulated controller, with both in hand."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from contextlib import suppress
from typing import Any

from drivers.errors import DeviceError
from drivers.twin import Twin
from tests.contract.leaping import LeapingLoop
from tests.contract.rigs.wheels import WheelsRig, wheels_rig
from tests.drivers.twin import rig

Test = Callable[[WheelsRig], Awaitable[None]]


def run(test: Test, *faults: str, opened: bool = True, drawn: bool = False, **options: Any) -> Twin:
    """``options`` are those of ``wheels_rig``; the twin is as the test left it."""
    twin = rig.twin(*faults, drawn=drawn)

    async def main() -> None:
        loop = asyncio.get_running_loop()
        assert isinstance(loop, LeapingLoop)
        bench = wheels_rig(twin, loop.time, **options)
        loop.busy = lambda: bench.port.busy or bench.wire.unread > 0
        try:
            if opened:
                await bench.device.open()
            await test(bench)
            twin.advance(loop.time())
        finally:
            with suppress(DeviceError):  # a device that a fault took away cannot be closed in order
                await bench.device.close()
            bench.wire.unplug()

    with asyncio.Runner(loop_factory=LeapingLoop) as runner:
        runner.run(main())
    return twin


def now() -> float:
    return asyncio.get_running_loop().time()


async def drive(bench: WheelsRig, seconds: float, speed_m_s: float, yaw_rate_rad_s: float = 0.0) -> None:
    """Renew a command at 20 Hz."""
    end_s = now() + seconds
    while now() < end_s:
        await bench.device.drive(speed_m_s, yaw_rate_rad_s)
        await asyncio.sleep(0.05)


def x_m(bench: WheelsRig) -> float:
    """Where the base truly is along the row."""
    bench.twin.advance(now())
    return bench.twin.base_pose[0]


def speed_m_s(bench: WheelsRig) -> float:
    """How fast the base truly is."""
    bench.twin.advance(now())
    return bench.twin.physics.drive.speeds_m_s[0]

"""A production receiver on the twin, in real time that leaps over silence."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from contextlib import suppress
from typing import Any

from drivers.errors import DeviceError
from drivers.gps.emulator import EmulatedReceiver
from drivers.gps.nmea import NmeaGps
from drivers.twin import Twin
from tests.contract.leaping import LeapingLoop
from tests.contract.rigged import Rigged
from tests.contract.rigs.gps import SENDS, emulated_gps
from tests.drivers.twin import rig

Test = Callable[[Rigged[NmeaGps], Twin], Awaitable[None]]


def run(test: Test, *faults: str, receiver: EmulatedReceiver = SENDS, opened: bool = True, **changes: Any) -> None:
    twin = rig.twin(*faults, **changes)

    async def main() -> None:
        loop = asyncio.get_running_loop()
        assert isinstance(loop, LeapingLoop)
        rigged = emulated_gps(twin, loop.time, receiver)
        loop.busy = rigged.busy
        try:
            if opened:
                await rigged.device.open()
            await test(rigged, twin)
        finally:
            with suppress(DeviceError):
                await rigged.device.close()
            await rigged.take_down()

    with asyncio.Runner(loop_factory=LeapingLoop) as runner:
        runner.run(main())


def now() -> float:
    return asyncio.get_running_loop().time()


async def lost(device: NmeaGps, longest_s: float = 5.0) -> None:
    """Until the port knows that its device is gone."""
    end_s = now() + longest_s
    while device.port.connected:
        assert now() < end_s, "waited in vain"
        await asyncio.sleep(0.01)

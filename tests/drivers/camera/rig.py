"""The emulated camera in a real loop, and drivers that look at it."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager

from drivers.camera.darkroom import InProcess
from drivers.camera.emulator import CameraEmulator
from drivers.camera.stereo_usb import StereoUsb
from drivers.twin import Twin
from tests.contract.leaping import LeapingLoop
from tests.contract.rigs.camera import end, settings_for


def run(main: Callable[[], Awaitable[None]], leaps: bool = False) -> None:
    """In real time that starts at 0; with ``leaps`` it skips what nobody needs."""

    async def all_of_it() -> None:
        loop = asyncio.get_running_loop()
        assert isinstance(loop, LeapingLoop)
        loop.busy = lambda: not leaps
        await main()

    with asyncio.Runner(loop_factory=LeapingLoop) as runner:
        runner.run(all_of_it())


@asynccontextmanager
async def plugged(twin: Twin) -> AsyncIterator[CameraEmulator]:
    """The twin's camera as a stream that is served."""
    emulator = CameraEmulator(twin, asyncio.get_running_loop().time, InProcess(lambda: twin.renderer))
    await emulator.plug()
    life = asyncio.create_task(emulator.serve())
    try:
        yield emulator
    finally:
        await end(life)


@asynccontextmanager
async def opened(twin: Twin, *places: str, **changes: object) -> AsyncIterator[StereoUsb]:
    """A driver that is open."""
    device = StereoUsb(settings_for(twin, *places, **changes), asyncio.get_running_loop().time)
    await device.open()
    try:
        yield device
    finally:
        await device.close()

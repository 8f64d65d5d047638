"""Production cameras and what they look at: the emulated stream, and a recording made from the twin."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from contextlib import suppress

from drivers.camera.darkroom import InProcess
from drivers.camera.emulator import CameraEmulator
from drivers.camera.stereo_usb import StereoUsb
from drivers.camera.stereo_usb_settings import StereoUsbSettings
from drivers.twin import Twin
from tests.contract.rigged import Rigged

PATIENT_S = 1.0  # on a machine that may be busy with other things


def settings_for(twin: Twin, *places: str, **changes: object) -> StereoUsbSettings:
    """A driver set for the twin's camera."""
    nominal = twin.nominal
    told: dict[str, object] = {
        "places": places,
        "image_size": nominal.optics.image_size,
        "exposure_s": nominal.exposure_s,
        "gain": nominal.gain,
        "rate_hz": nominal.camera_rate_hz,
        "white_balance_k": 5600.0,
        "latency_s": nominal.camera_readout_s,
        "frame_timeout_s": PATIENT_S,
    }
    return StereoUsbSettings(**told | changes)  # type: ignore[arg-type]


class _PluggedFirst(StereoUsb):
    """The driver, with its camera plugged in before it is opened."""

    plug: Callable[[], Awaitable[None]]

    async def open(self) -> None:
        await self.plug()
        await super().open()


def emulated_camera(twin: Twin, clock: Callable[[], float]) -> Rigged[StereoUsb]:
    emulator = CameraEmulator(twin, clock, InProcess(lambda: twin.renderer))
    device = _PluggedFirst(settings_for(twin, emulator.url), clock)
    device.plug = emulator.plug
    life = asyncio.get_running_loop().create_task(emulator.serve())
    return Rigged(device, more_busy=lambda: True, before_unplugging=lambda: end(life))


async def end(life: asyncio.Task[None]) -> None:
    life.cancel()
    with suppress(asyncio.CancelledError):
        await life

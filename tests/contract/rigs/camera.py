"""Production cameras and what they look at: the emulated stream, and a recording made from the twin."""

from __future__ import annotations

import asyncio
import shutil
import tempfile
from collections.abc import Awaitable, Callable
from contextlib import suppress
from pathlib import Path

import cv2

from drivers.camera.darkroom import InProcess
from drivers.camera.emulator import CameraEmulator
from drivers.camera.files import FilesCamera, FilesSettings
from drivers.camera.stereo_usb import StereoUsb
from drivers.camera.stereo_usb_settings import StereoUsbSettings
from drivers.twin import Twin
from tests.contract.rigged import Rigged

RECORDINGS = ("files",)  # of the cameras under contract, those that show what was, not what is
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


def recorded_camera(twin: Twin, clock: Callable[[], float]) -> Rigged[FilesCamera]:
    """A recording of a few pairs, looped."""
    nominal = twin.nominal
    settings = FilesSettings(
        record(twin, Path(tempfile.mkdtemp(prefix="recording-"))), nominal.optics.image_size, nominal.exposure_s,
        nominal.gain, nominal.camera_rate_hz,
    )  # fmt: skip

    async def forget() -> None:
        shutil.rmtree(settings.source)

    return Rigged(FilesCamera(settings, clock), before_unplugging=forget)


def record(twin: Twin, folder: Path, pairs: int = 3) -> Path:
    """What the twin's camera sees, as images in a folder."""
    for number in range(pairs):
        views = twin.expose(0.0, twin.nominal.exposure_s, twin.nominal.gain, number)
        for side, view in zip(("left", "right"), views, strict=True):
            cv2.imwrite(str(folder / f"{number:03d}_{side}.png"), view)
    return folder


async def end(life: asyncio.Task[None]) -> None:
    life.cancel()
    with suppress(asyncio.CancelledError):
        await life

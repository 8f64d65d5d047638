"""A stereo camera on the twin."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable
from dataclasses import replace

from drivers.camera.values import StereoFrame
from drivers.twin.bus import SLOW_FACTOR, Bus
from drivers.twin.faults import Verb
from drivers.twin.machine import Twin

TIMEOUT_S = 1.0


class MockCamera:
    """Implements ``drivers.camera.interface.StereoCamera``; ``clock`` gives loop time.

    It runs freely at its rate; ``sequence`` numbers its frames, those that nobody asked for included.
    """

    def __init__(self, twin: Twin, clock: Callable[[], float]) -> None:
        self._twin, self._clock = twin, clock
        self._bus = Bus(twin, clock, "camera", 0.0, TIMEOUT_S)
        self._exposure_s, self._gain = twin.nominal.exposure_s, twin.nominal.gain

    @property
    def image_size(self) -> tuple[int, int]:
        return self._twin.nominal.optics.image_size

    async def open(self) -> None:
        await self._bus.connect()

    async def close(self) -> None:
        self._bus.disconnect()

    async def capture(self) -> StereoFrame:
        self._bus.require_open()
        await self._bus.require_answer()
        rate_hz, exposure_s, gain = self._twin.nominal.camera_rate_hz, self._exposure_s, self._gain
        sequence = math.floor(self._clock() * rate_hz + 1e-6) + 1
        await asyncio.sleep(sequence / rate_hz + 0.5 * exposure_s - self._clock())
        stamp_s = self._clock()
        left, right = self._twin.expose(stamp_s, exposure_s, gain, sequence)
        verb = self._bus.verb
        readout_s = self._twin.nominal.camera_readout_s * (SLOW_FACTOR if verb is Verb.SLOW else 1.0)
        await asyncio.sleep(0.5 * exposure_s + readout_s)
        self._bus.require_open()
        await self._bus.require_answer()
        await self._bus.require_clean_answer(verb)
        frame = self._bus.seen(StereoFrame(stamp_s, sequence, left, right, exposure_s, gain), _views_swapped)
        return replace(frame, sequence=sequence)

    async def set_exposure(self, exposure_s: float, gain: float) -> None:
        nominal = self._twin.nominal
        if not nominal.exposure_min_s <= exposure_s <= nominal.exposure_max_s:
            low, high = nominal.exposure_min_s, nominal.exposure_max_s
            raise ValueError(f"exposure: expected {low:g} to {high:g} s, found {exposure_s:g} s; choose one within")
        if not 1.0 <= gain <= nominal.gain_max:
            raise ValueError(f"gain: expected 1 to {nominal.gain_max:g}, found {gain:g}; choose one within")
        self._bus.require_open()
        await self._bus.require_answer()
        self._exposure_s, self._gain = exposure_s, gain


def _views_swapped(frame: StereoFrame) -> StereoFrame:
    return replace(frame, left=frame.right, right=frame.left)

"""What all mocks share: a line to the twin with its latency, and the declared faults of that line."""

from __future__ import annotations

import asyncio
import math
import zlib
from collections.abc import Callable
from dataclasses import replace
from typing import TypeVar

import numpy as np

from drivers.arm.values import ArmState
from drivers.camera.values import StereoFrame
from drivers.errors import DeviceFault, DeviceLost, DeviceMissing, DeviceTimeout
from drivers.gps.values import Fix
from drivers.inputs.values import InputState
from drivers.modem.values import ModemStatus
from drivers.relay.values import RelayState
from drivers.twin.faults import Verb
from drivers.twin.machine import Twin
from drivers.wheels.values import Odometry

T = TypeVar("T")
Reading = TypeVar("Reading", ArmState, Fix, InputState, ModemStatus, Odometry, RelayState, StereoFrame)

SLOW_FACTOR = 10.0
JITTER_SHARE = 0.1
STALE_S = 1.0
LATE_S = 0.3
FAILING_SHARE = 0.5
_ANSWERLESS = (Verb.UNPLUGGED, Verb.OFF)


class Bus:
    """One exchange at a time. ``timeout_s`` is how long the driver waits for an answer that does not come."""

    def __init__(
        self, twin: Twin, clock: Callable[[], float], device: str, round_trip_s: float, timeout_s: float
    ) -> None:
        self.twin, self.clock = twin, clock
        self._device, self._round_trip_s, self._timeout_s = device, round_trip_s, timeout_s
        self._random = np.random.default_rng([twin.seed, zlib.crc32(device.encode())])
        self._lock = asyncio.Lock()
        self._is_open = False
        self._free_s = -math.inf  # when the answer to the last request is through
        self._frozen: object = None

    @property
    def verb(self) -> Verb:
        """What the device does wrong at present."""
        return self.twin.verb(self._device, self.clock())

    async def connect(self) -> None:
        if self.verb is Verb.UNPLUGGED:
            raise DeviceMissing(self._device, "its port", "nothing there", "plug it in")
        if self.verb is Verb.OFF:
            await asyncio.sleep(self._timeout_s)
            raise DeviceMissing(
                self._device, "an answer to the first request", "silence", "check its power and its cable"
            )
        self._is_open = True

    def disconnect(self) -> None:
        self._is_open = False

    def require_open(self) -> None:
        if not self._is_open:
            raise DeviceLost(self._device, "an open connection", "a closed one", "open the device first")

    async def exchange(self, read: Callable[[], T], send: Callable[[float], None] | None = None) -> T:
        """Send a request, wait for the answer. ``send`` gets the time of arrival; ``read`` is asked after that time.

        Once sent a request takes effect, whether or not the caller still waits or the answer comes through; the line
        stays busy until the answer is due.
        """
        self.require_open()
        async with self._lock:
            if (verb := self.verb) in _ANSWERLESS:
                await self.require_answer()
                verb = self.verb
            trip_s = self._round_trip_s * (1.0 + JITTER_SHARE * float(self._random.random()))
            half_s = 0.5 * trip_s * (SLOW_FACTOR if verb is Verb.SLOW else 1.0)
            if (busy_s := self._free_s - self.clock()) > 0.0:
                await asyncio.sleep(busy_s)
            self._free_s = self.clock() + 2.0 * half_s
            if send is not None:
                late_s = LATE_S if verb is Verb.DELAYED else 0.0
                send(self.clock() + half_s + late_s)
            await asyncio.sleep(half_s)
            answer = read()
            await asyncio.sleep(half_s)
            if verb is not Verb.OK:
                await self.require_clean_answer(verb)
            return answer

    async def require_answer(self) -> None:
        """Raise when the port is gone; wait for the time-out and raise when the device is silent."""
        if self.verb is Verb.UNPLUGGED:
            raise DeviceLost(self._device, "its port to be there", "it unplugged", "plug it in again")
        if self.verb is Verb.OFF:
            await self._time_out()

    async def require_clean_answer(self, verb: Verb) -> None:
        """Raise when an answer under ``verb`` does not come through."""
        if verb is Verb.GARBAGE:
            raise DeviceFault(self._device, "a valid answer", "a garbled answer", "check the cable and its shield")
        if verb is Verb.INTERMITTENT and self._random.random() < FAILING_SHARE:
            await self._time_out()

    def seen(self, reading: Reading, wrong: Callable[[Reading], Reading]) -> Reading:
        """The reading as a faulty sensor gives it: frozen, stale, or off as ``wrong`` makes it."""
        verb = self.verb
        if verb is Verb.STUCK:
            if not isinstance(self._frozen, type(reading)):
                self._frozen = reading
            return replace(self._frozen, stamp_s=reading.stamp_s)
        self._frozen = None
        if verb is Verb.DELAYED:
            return replace(reading, stamp_s=reading.stamp_s - STALE_S)
        return wrong(reading) if verb is Verb.WRONG else reading

    async def _time_out(self) -> None:
        await asyncio.sleep(self._timeout_s)
        raise DeviceTimeout(
            self._device,
            f"an answer within {self._timeout_s:g} s",
            "silence",
            "check its power and its cable; its state is unknown",
        )

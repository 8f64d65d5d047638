"""A GPS receiver on the twin."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from drivers.gps.values import Fix
from drivers.twin.bus import SLOW_FACTOR, Bus
from drivers.twin.faults import Verb
from drivers.twin.machine import Twin
from drivers.twin.receiver import OUTPUT_DELAY_S

TIMEOUT_S = 2.0


class MockGps:
    """Implements ``drivers.gps.interface.Gps``; ``clock`` gives loop time. A fix is stamped with its epoch."""

    def __init__(self, twin: Twin, clock: Callable[[], float]) -> None:
        self._twin, self._clock = twin, clock
        self._bus = Bus(twin, clock, "gps", 0.0, TIMEOUT_S)

    async def open(self) -> None:
        await self._bus.connect()

    async def close(self) -> None:
        self._bus.disconnect()

    async def next_fix(self) -> Fix:
        self._bus.require_open()
        await self._bus.require_answer()
        epoch_s = self._twin.next_epoch_s(self._clock())
        await asyncio.sleep(epoch_s - self._clock())
        fix = self._twin.fix(self._clock())
        verb = self._bus.verb
        await asyncio.sleep(OUTPUT_DELAY_S * (SLOW_FACTOR if verb is Verb.SLOW else 1.0))
        self._bus.require_open()
        await self._bus.require_answer()
        await self._bus.require_clean_answer(verb)
        return self._bus.seen(fix, lambda wrong: wrong)  # WRONG is multipath, which is the receiver's own

"""How late the event loop comes to what is due: the first thing to look at when a robot reacts slowly."""

from __future__ import annotations

import asyncio
from bisect import bisect_left

from robot.control import LatenessCounts

TICK_S = 0.02
BOUNDS_S = (0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.25, 1.0)


class LoopLateness:
    """Counts the lateness of ticks of ``TICK_S``; in real time only (virtual time is never late)."""

    def __init__(self) -> None:
        self._counts = [0] * (len(BOUNDS_S) + 1)
        self._sum_s = 0.0

    async def tick(self) -> None:
        loop = asyncio.get_running_loop()
        due_s = loop.time() + TICK_S
        await asyncio.sleep(TICK_S)
        late_s = max(0.0, loop.time() - due_s)
        self._counts[bisect_left(BOUNDS_S, late_s)] += 1
        self._sum_s += late_s

    @property
    def counts(self) -> LatenessCounts:
        return LatenessCounts(BOUNDS_S, tuple(self._counts), self._sum_s)

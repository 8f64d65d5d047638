"""An event loop in real time that leaps over the time in which nothing is under way.

Production drivers speak over ptys from threads of their own, so virtual time is not for them. Here the clock is the
wall's as long as a port is busy or bytes are unread, and jumps to the next timer when all has been quiet for a moment.
"""

from __future__ import annotations

import asyncio
import selectors
import time
from collections.abc import Callable

DWELL_S = 0.002


class _Selector(selectors.SelectSelector):  # select(2) waits for microseconds, epoll for milliseconds
    loop: LeapingLoop | None = None

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        loop = self.loop
        if loop is None or timeout is None or timeout <= DWELL_S:
            return super().select(timeout)
        end_s = time.monotonic() + timeout
        while True:
            rest_s = end_s - time.monotonic()
            if events := super().select(max(0.0, min(DWELL_S, rest_s))):
                return events
            rest_s = end_s - time.monotonic()
            if rest_s <= 0.0:
                return []
            if not loop.busy():
                if events := super().select(0.0):
                    return events
                loop.leap(rest_s)
                return []


class LeapingLoop(asyncio.SelectorEventLoop):
    """Its clock starts at 0. ``busy`` says whether something is under way outside the loop; it may be replaced."""

    def __init__(self) -> None:
        selector = _Selector()
        self._zero_s = time.monotonic()
        self.busy: Callable[[], bool] = lambda: False
        super().__init__(selector)
        selector.loop = self

    def time(self) -> float:
        return time.monotonic() - self._zero_s

    def leap(self, by_s: float) -> None:
        self._zero_s -= by_s

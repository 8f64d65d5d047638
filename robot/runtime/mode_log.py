"""Writes safety's mode changes into the ledger, without ever holding up or failing the stop that causes one."""

from __future__ import annotations

import asyncio
from collections import deque

from robot.actuation import LEDGER_WRITE_S
from robot.clock import work
from robot.errors import FileError
from robot.ledger import Ledger, LedgerRuleError

RETRY_S = 1.0
MODE_EVENT = "mode"


class ModeLog:
    """A queue before the ledger: ``put`` returns at once, ``run`` writes in order.

    A line that the disk does not take is kept and tried again, so that a full disk takes nobody's stop away;
    ``problem`` says why lines wait, "" when none does.
    """

    def __init__(self, ledger: Ledger) -> None:
        self._ledger = ledger
        self._lines: deque[tuple[str, float]] = deque()
        self._more = asyncio.Event()
        self.problem = ""

    def put(self, text: str, stamp_s: float) -> None:
        self._lines.append((text, stamp_s))
        self._more.set()

    async def run(self) -> None:
        """Until cancelled; a line under way is finished first."""
        while True:
            await self._more.wait()
            writing = asyncio.create_task(self._write_waiting(), name="mode log lines")
            try:
                await asyncio.shield(writing)
            except asyncio.CancelledError:
                await writing
                raise
            if self.problem:
                await asyncio.sleep(RETRY_S)

    def write_rest(self) -> None:
        """What is still unwritten when the run ends. ``FileError`` when the ledger fails."""
        while self._lines:
            self._record(*self._lines[0])
            self._lines.popleft()

    async def _write_waiting(self) -> None:
        self._more.clear()
        try:
            while self._lines:
                text, stamp_s = self._lines[0]
                await work(lambda: self._record(text, stamp_s), LEDGER_WRITE_S)  # noqa: B023 - done before the next
                self._lines.popleft()
        except LedgerRuleError:
            self._lines.popleft()  # it will never be taken
            raise
        except FileError as error:
            self.problem = str(error)
            self._more.set()
        else:
            self.problem = ""

    def _record(self, text: str, stamp_s: float) -> None:
        self._ledger.record_event(MODE_EVENT, text, stamp_s)

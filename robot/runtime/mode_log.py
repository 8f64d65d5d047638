"""Writes safety's mode changes into the ledger, without ever holding up or failing the stop that causes one."""

from __future__ import annotations

import asyncio

from robot.actuation import LEDGER_WRITE_S
from robot.clock import work
from robot.ledger import Ledger


class ModeLog:
    """A queue before the ledger: ``put`` returns at once, ``run`` writes in order and raises what the ledger raises."""

    def __init__(self, ledger: Ledger) -> None:
        self._ledger = ledger
        self._lines: asyncio.Queue[tuple[str, float]] = asyncio.Queue()

    def put(self, text: str, stamp_s: float) -> None:
        self._lines.put_nowait((text, stamp_s))

    async def run(self) -> None:
        """Until cancelled; a line under way is finished first."""
        while True:
            text, stamp_s = await self._lines.get()
            writing = asyncio.create_task(self._write(text, stamp_s), name="mode log line")
            try:
                await asyncio.shield(writing)
            except asyncio.CancelledError:
                await writing
                raise

    def write_rest(self) -> None:
        """What is still unwritten when the run ends. ``FileError`` when the ledger fails."""
        while not self._lines.empty():
            text, stamp_s = self._lines.get_nowait()
            self._ledger.record_event("mode", text, stamp_s)

    async def _write(self, text: str, stamp_s: float) -> None:
        await work(lambda: self._ledger.record_event("mode", text, stamp_s), LEDGER_WRITE_S)

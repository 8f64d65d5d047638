"""What must get into the ledger: kept in memory until it is there, and tried again."""

from __future__ import annotations

import asyncio
import math
from collections import deque
from collections.abc import Callable
from typing import TypeVar

from robot.actuation import values
from robot.actuation.gate import now_s
from robot.actuation.values import Refused
from robot.clock import work
from robot.errors import FileError
from robot.ledger import SLOW_S, Ledger, LedgerRuleError, MeterMark, WriteLatency
from robot.ledger.values import Intent, Leak, Result

RETRY_S = 0.5
SLOW_FOR_S = 60.0  # a disk that was slow counts as slow for so long

T = TypeVar("T")


class Bookkeeper:
    """Writes intents, outcomes and leaks off the loop, in order. ``problem`` says why rows wait, "" when none does.

    An outcome or a leak that the ledger does not take is tried again with every ``retry`` and at the end; when the
    program ends before, the next one finds the intent without an outcome and books it as the full pulse.
    """

    def __init__(self, ledger: Ledger) -> None:
        self._ledger = ledger
        self._rows: deque[Callable[[], object]] = deque()
        self._writing = asyncio.Lock()
        self._retrying: asyncio.Task[None] | None = None
        self._next_try_s = -math.inf
        self.latency = WriteLatency()  # as shots wait for it, on the loop's clock
        self._slow_until_s = -math.inf
        self.problem = ""

    @property
    def faults(self) -> dict[str, str]:
        """By their number in the catalogue: what is wrong with the ledger's disk now."""
        found: dict[str, str] = {}
        if self.problem:
            found["F38" if "can be written" in self.problem else "F36"] = self.problem
        if now_s() < self._slow_until_s:
            found["F39"] = self.latency.warning
        return found

    async def intent(self, task_id: int, intent: Intent) -> int:
        """Durable when it returns. ``Refused`` as long as earlier rows wait; errors of the ledger as they are."""
        if self._rows:
            raise Refused(f"{len(self._rows)} rows wait for the ledger, no ledger, no spray: {self.problem}")
        try:
            return await self._timed(lambda: self._ledger.write_intent(task_id, intent))
        except FileError as error:
            self.problem, stamp_s = str(error), now_s()
            text = f"intent refused: {error}"
            self._rows.append(lambda: self._ledger.record_event("fault", text, stamp_s))  # and so the disk is tried
            raise

    async def result(self, intent_id: int, result: Result, count_ml: float | None) -> None:
        """Durable when it returns; when it raises ``FileError`` the outcome is kept and tried again.

        ``count_ml`` is the meter's count up to which everything is booked with it, None without one.
        """
        self._rows.append(lambda: self._ledger.write_result(intent_id, result, count_ml))
        await self.write_all()

    def leak(self, task_id: int | None, leak: Leak, count_ml: float | None) -> None:
        """Taken down at once, written soon: nothing waits for the disk while liquid runs."""
        self._rows.append(lambda: self._ledger.write_leak(task_id, leak, count_ml))
        self._next_try_s = -math.inf
        self.retry()

    async def begin_metering(
        self, task_id: int | None, count_ml: float, missed: Callable[[MeterMark], Leak | None]
    ) -> None:
        """Book what ``missed`` finds since the last run's mark, on that run's task, and mark ``count_ml``, in one."""

        def write() -> None:
            mark = self._ledger.meter_mark()
            leak = None if mark is None else missed(mark)
            if mark is not None and leak is not None:
                self._ledger.write_leak(mark.task_id, leak, count_ml)
            self._ledger.mark_meter(task_id, count_ml)

        await work(write, values.LEDGER_WRITE_S)

    def retry(self) -> None:
        """Try what waits, if it is time again; does not wait for the disk."""
        idle = self._retrying is None or self._retrying.done()
        if self._rows and idle and not self._writing.locked() and now_s() >= self._next_try_s:
            self._retrying = asyncio.create_task(self._try(), name="ledger retry")

    async def finish(self) -> str:
        """The last try, before the program ends; why rows are lost, "" when none is."""
        if self._retrying is not None:
            await self._retrying
        await self._try()
        return self.problem

    async def write_all(self) -> None:
        """Everything that waits, in order. ``FileError`` with the first failure; the rest goes on waiting."""
        async with self._writing:
            while self._rows:
                try:
                    await self._timed(self._rows[0])
                except FileError as error:
                    self.problem = str(error)
                    self._next_try_s = now_s() + RETRY_S
                    raise
                except LedgerRuleError:
                    self._rows.popleft()  # it will never be taken
                    raise
                self._rows.popleft()
            self.problem = ""

    async def _timed(self, write: Callable[[], T]) -> T:
        began_s = now_s()
        try:
            return await work(write, values.LEDGER_WRITE_S)
        finally:
            took_s = now_s() - began_s
            self.latency = self.latency.with_write(took_s)
            if took_s > SLOW_S:
                self._slow_until_s = now_s() + SLOW_FOR_S

    async def _try(self) -> None:
        try:
            await self.write_all()
        except (FileError, LedgerRuleError) as error:
            self.problem = str(error)

"""SIGINT and SIGTERM in the life of the robot: none is lost, none comes too early or too late."""

from __future__ import annotations

import asyncio
import signal
from types import FrameType, TracebackType
from typing import Self

STOPPING = (signal.SIGINT, signal.SIGTERM)


class StopSignals:
    """Hears the signals that end a run, from ``install`` on, also before there is a loop and after it is closed.

    ``name`` is the first that came, "" before. As a context manager it puts the former handlers back.
    """

    def __init__(self) -> None:
        self.name = ""
        self._loop: asyncio.AbstractEventLoop | None = None
        self._came = asyncio.Event()
        self._former: dict[signal.Signals, object] = {}

    def install(self) -> Self:
        self._former = {number: signal.signal(number, self.take) for number in STOPPING}
        return self

    async def wait(self) -> str:
        """The name of the first signal, at once when it came before."""
        self._loop = asyncio.get_running_loop()
        if self.name:
            self._came.set()
        await self._came.wait()
        return self.name

    def __enter__(self) -> Self:
        return self.install()

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for number, handler in self._former.items():
            signal.signal(number, handler)  # type: ignore[arg-type]

    def take(self, number: int, _frame: FrameType | None = None) -> None:
        """The signal has come: what the handler calls, and who plays a service manager."""
        self.name = self.name or signal.Signals(number).name
        if self._loop is not None and not self._loop.is_closed():
            self._loop.call_soon_threadsafe(self._came.set)

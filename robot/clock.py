"""The event loop is the clock: real time for hardware, virtual time for simulated runs.

``VirtualClockLoop`` jumps to its next timer when it has nothing to do. With a ``pace`` the same jumps take
``1 / pace`` of their length in real time, so that a person can watch. The results are the same to the last bit:
work in threads has a modelled duration, and its result is handed over exactly when that is over.
"""

from __future__ import annotations

import asyncio
import gc
import heapq
import selectors
import time
from collections.abc import Callable, Coroutine
from concurrent.futures import ThreadPoolExecutor
from contextvars import Context
from typing import Any, NoReturn, TypeVar, TypeVarTuple, Unpack

T = TypeVar("T")
Ts = TypeVarTuple("Ts")

_LONGEST_NAP_S = 0.05
_LOOKS_BUSY = 16  # a loop that is busy looks for signals every so many rounds


class _JumpingSelector(selectors.DefaultSelector):
    """A selector whose waits move the loop's clock instead of the wall's."""

    loop: VirtualClockLoop | None = None
    _skipped = 0

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        if self.loop is None:
            return super().select(timeout)
        if timeout is None or timeout > 0:
            return self.loop.idle(super().select)
        self._skipped = (self._skipped + 1) % _LOOKS_BUSY  # only signals come this way, and ``idle`` looks too
        return super().select(0) if self._skipped == 0 else []


class VirtualClockLoop(asyncio.SelectorEventLoop):
    """An event loop in virtual time, for mock back ends only; its clock starts at 0.

    Ptys, sockets and threads of their own run in real time and would race with it, so they are refused.
    ``pace`` is virtual seconds a real second; None is as fast as the machine can. Without ``threads`` work runs where
    the loop runs, with the same results: quicker where much of it is small, and nothing is ever half done.
    """

    def __init__(self, pace: float | None = None, threads: bool = True) -> None:
        selector = _JumpingSelector()
        self._now_s = 0.0
        self._timers_s: list[float] = []
        super().__init__(selector)
        self._pace = pace
        self._threads = threads
        self._jumps = 0
        self._unfinished: dict[asyncio.Future[Any], float] = {}
        self._workers = ThreadPoolExecutor(max_workers=2, thread_name_prefix="work")
        self._real_mark_s = time.monotonic()
        self._virtual_mark_s = 0.0
        selector.loop = self
        if pace is not None and pace <= 0:
            self.close()
            raise ValueError(f"pace must be positive, got {pace}")

    def time(self) -> float:
        return self._now_s

    def call_at(
        self, when: float, callback: Callable[[Unpack[Ts]], object], *args: *Ts, context: Context | None = None
    ) -> asyncio.TimerHandle:
        heapq.heappush(self._timers_s, when)
        return super().call_at(when, self._run_timer, when, callback, args, context=context)

    def _run_timer(self, when: float, callback: Callable[[Unpack[Ts]], object], args: tuple[*Ts]) -> None:
        """asyncio runs timers up to its clock's resolution early; here the clock is moved on, so that none is early."""
        self._now_s = max(self._now_s, when)
        callback(*args)

    def idle(
        self, wait: Callable[[float | None], list[tuple[selectors.SelectorKey, int]]]
    ) -> list[tuple[selectors.SelectorKey, int]]:
        """Called when nothing is ready: go to the next timer, but not past the due time of unfinished work."""
        while self._timers_s and self._timers_s[0] <= self._now_s:
            heapq.heappop(self._timers_s)
        next_timer_s = self._timers_s[0] if self._timers_s else None
        held_s = min(self._unfinished.values(), default=None)
        if held_s is not None and (next_timer_s is None or held_s <= next_timer_s):
            if held_s > self._now_s:
                return self._advance(held_s, wait)
            return wait(None)  # the clock stands still until the work is done
        if next_timer_s is None:
            return wait(None)
        return self._advance(next_timer_s, wait)

    def _advance(
        self, until_s: float, wait: Callable[[float | None], list[tuple[selectors.SelectorKey, int]]]
    ) -> list[tuple[selectors.SelectorKey, int]]:
        if self._pace is not None:
            real_due_s = self._real_mark_s + (until_s - self._virtual_mark_s) / self._pace
            while (rest_s := real_due_s - time.monotonic()) > 0:
                if events := wait(min(rest_s, _LONGEST_NAP_S)):
                    return events
            if -rest_s > _LONGEST_NAP_S:  # slower than the pace: go on from here, do not race to catch up
                self._real_mark_s, self._virtual_mark_s = time.monotonic(), until_s
        self._jumps = (self._jumps + 1) % _LOOKS_BUSY
        if (self._threads or self._jumps == 0) and (events := wait(0)):
            return events  # a signal is heard before the clock jumps, not one timer later
        self._now_s = until_s
        return []

    async def run_work(self, function: Callable[[], T], duration_s: float) -> T:
        """Run ``function`` in a thread; its result comes exactly ``duration_s`` virtual seconds from now."""
        if not self._threads:
            return await self._run_here(function, duration_s)
        due_s = self._now_s + duration_s
        future: asyncio.Future[T] = asyncio.wrap_future(self._workers.submit(function), loop=self)
        self._unfinished[future] = due_s
        future.add_done_callback(self._unfinished.pop)
        await asyncio.sleep(duration_s)
        return await asyncio.shield(future)

    async def _run_here(self, function: Callable[[], T], duration_s: float) -> T:
        """An error comes when the work is over, as from a thread."""
        future: asyncio.Future[T] = self.create_future()
        try:
            future.set_result(function())
        except Exception as error:  # noqa: BLE001 - handed over, not dropped
            future.set_exception(error)
        try:
            await asyncio.sleep(duration_s)
        except BaseException:
            future.exception()  # nobody waits for it any more
            raise
        return future.result()

    def close(self) -> None:
        self._workers.shutdown(wait=True)
        super().close()

    def _refuse(self, *_args: Any, **_kwargs: Any) -> NoReturn:
        raise RuntimeError("virtual time is for mock back ends: sockets, ptys and threads need the real clock")

    add_reader = add_writer = run_in_executor = _refuse  # type: ignore[assignment]
    create_connection = create_server = create_unix_connection = create_unix_server = _refuse
    create_datagram_endpoint = connect_read_pipe = connect_write_pipe = subprocess_exec = _refuse


async def work(function: Callable[[], T], duration_s: float) -> T:
    """Run blocking or heavy work off the loop: the one door to threads.

    In virtual time it takes exactly ``duration_s``, whatever the machine needs; in real time as long as it takes.
    A cancelled caller leaves at once; the work itself goes on to its end.
    """
    loop = asyncio.get_running_loop()
    if isinstance(loop, VirtualClockLoop):
        return await loop.run_work(function, duration_s)
    return await asyncio.shield(loop.run_in_executor(None, function))


class RealClockLoop(asyncio.SelectorEventLoop):
    """An event loop in real time whose clock shows the seconds since ``zero_s`` (of the monotonic clock).

    That clock is the same in every process of a machine: two loops with one zero have one time. ``precise``: timers are
    good to microseconds (select; epoll rounds to milliseconds).
    """

    def __init__(self, zero_s: float | None = None, precise: bool = False) -> None:
        self.zero_s = time.monotonic() if zero_s is None else zero_s
        super().__init__(selectors.SelectSelector() if precise else None)

    def time(self) -> float:
        return time.monotonic() - self.zero_s


def keep_time() -> None:
    """What is alive now will stay alive: the garbage collector need not go through it again and hold everything up."""
    gc.collect()
    gc.freeze()


def run_real(main: Coroutine[Any, Any, T]) -> T:
    """Run a coroutine to its end in real time, on a clock that starts at 0."""
    with asyncio.Runner(loop_factory=RealClockLoop) as runner:
        return runner.run(main)


def run_virtual(main: Coroutine[Any, Any, T], pace: float | None = None) -> T:
    """Run a coroutine to its end in virtual time."""
    with asyncio.Runner(loop_factory=lambda: VirtualClockLoop(pace)) as runner:
        return runner.run(main)

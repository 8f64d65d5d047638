"""One owner thread for one serial device: jobs in order, a STOP lane that overtakes them, reconnection.

Whatever speaks over the port runs as a job in the owner thread, so that no two frames ever mix and no blocking read
holds up the event loop. When the device goes, waiting and new jobs end in ``DeviceLost`` at once, and the owner looks
for the device under its stable name with growing pauses. What must be said before anything else (identity, settings,
everything off) is said by greetings, at every opening, before the first job.
"""

from __future__ import annotations

import asyncio
import heapq
import itertools
import os
import select
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any, TypeVar

from drivers.byte_trace import ByteTrace, Direction
from drivers.errors import DeviceError, DeviceFault, DeviceLost
from drivers.line import Line, PortSettings, write_all

T = TypeVar("T")
Greeting = Callable[[Line], None]

FIRST_RETRY_S = 0.2
LONGEST_RETRY_S = 5.0
JOIN_S = 5.0
BESIDE_TIMEOUT_S = 0.1


@dataclass(slots=True)
class PortStatistics:
    """What went over the port since it was made."""

    bytes_out: int = 0
    bytes_in: int = 0
    stray_bytes: int = 0
    jobs: int = 0
    openings: int = 0
    losses: int = 0


@dataclass(order=True)
class Timer:
    """A job for later; it is not run once ``cancelled``."""

    due_s: float
    number: int
    job: Callable[[Line], None] = field(compare=False)
    cancelled: bool = field(default=False, compare=False)


@dataclass(slots=True)
class _Job:
    run: Callable[[Line], Any]
    future: Future[Any]


class SerialPort:
    """A serial device that several drivers may share (``attach``); the last to ``detach`` closes it.

    ``clock`` gives loop time and is read from both threads. ``on_bytes`` gets what comes in while no job runs, in the
    owner thread; without it such bytes are thrown away and counted.
    """

    def __init__(
        self,
        settings: PortSettings,
        clock: Callable[[], float],
        *,
        on_bytes: Callable[[bytes], None] | None = None,
        trace: ByteTrace | None = None,
    ) -> None:
        self.settings = settings
        self.statistics = PortStatistics()
        self._clock, self._on_bytes, self._trace = clock, on_bytes, trace
        self._mutex = threading.Lock()
        self._greetings: dict[str, Greeting] = {}
        self._jobs: deque[_Job] = deque()
        self._stops: deque[_Job] = deque()
        self._timers: list[Timer] = []
        self._numbers = itertools.count()
        self._running = False
        self._closing = False
        self._thread: threading.Thread | None = None
        self._bell = -1
        self._line: Line | None = None
        self._defect: BaseException | None = None
        self._lost_s = 0.0
        self._lost_because = ""
        self._retry_s = FIRST_RETRY_S
        self._retry_at_s = 0.0

    # --- for drivers, on the event loop -----------------------------------------------------------------------

    async def attach(self, user: str, greet: Greeting) -> None:
        """Open the port unless it is open, and run ``greet`` in the owner thread, now and after every reconnection.

        Raises what opening and greeting raise: ``DeviceMissing``, ``DeviceBusy``, or the greeting's own error; the
        user is then not attached.
        """
        if self._thread is None:
            self._start()
        self._greetings[user] = greet
        try:
            await self._submit(self._jobs, greet, opens=True)
        except BaseException:
            await self.detach(user)
            raise

    async def detach(self, user: str) -> None:
        """Leave the port; the last user closes it."""
        self._greetings.pop(user, None)
        if not self._greetings and self._thread is not None:
            thread, self._thread = self._thread, None
            self._closing = True
            self._ring()
            await asyncio.shield(asyncio.get_running_loop().run_in_executor(None, thread.join, JOIN_S))

    async def run(self, job: Callable[[Line], T]) -> T:
        """Run a job in its turn, to its end even when the caller is cancelled. ``DeviceLost`` without a device."""
        return await self._submit(self._jobs, job)

    async def stop(self, job: Callable[[Line], T]) -> T:
        """Like ``run``, before everything that waits."""
        return await self._submit(self._stops, job)

    async def _submit(self, lane: deque[_Job], job: Callable[[Line], T], opens: bool = False) -> T:
        future = asyncio.wrap_future(self._post(lane, job, opens))
        future.add_done_callback(_retrieve)
        return await asyncio.shield(future)

    # --- from any thread --------------------------------------------------------------------------------------

    def post_stop(self, job: Callable[[Line], T]) -> Future[T]:
        """Like ``stop``, from any thread and without waiting."""
        return self._post(self._stops, job)

    def write_beside(self, frames: Sequence[bytes], gap_s: float) -> None:
        """Write beside an owner that hangs, on a duplicate of its descriptor; ``gap_s`` of silence after each frame.

        Whatever is under way on the line may garble the first frames: repeat what matters. Nothing is read.
        ``DeviceLost`` without a device, ``DeviceTimeout`` when it takes nothing.
        """
        with self._mutex:  # the owner parts with its line under the mutex before it closes it
            line = self._line
            if line is None:
                raise self._closed() if self._thread is None or not self._lost_because else self._gone()
            duplicate = os.dup(line.descriptor)
        try:
            for frame in frames:
                write_all(duplicate, frame, BESIDE_TIMEOUT_S, self.settings.device)
                self._keep("out", frame)
                time.sleep(gap_s)  # nobody waits for an answer: this is the silence that parts frames on the wire
        except OSError as error:
            raise DeviceLost(
                self.settings.device, f"{self.settings.path} to be there", f"it gone ({error.strerror or error})",
                "plug it in again; it is looked for until it is back",
            ) from error  # fmt: skip
        finally:
            os.close(duplicate)

    def at(self, due_s: float, job: Callable[[Line], None]) -> Timer:
        """Run a job in the owner thread at ``due_s`` of the clock. It sees to its own errors; one that it lets go is
        raised to the next who calls ``run``.
        """
        timer = Timer(due_s, next(self._numbers), job)
        with self._mutex:
            heapq.heappush(self._timers, timer)
        self._ring()
        return timer

    @property
    def busy(self) -> bool:
        """Whether a job or a timer waits or runs."""
        with self._mutex:
            waits = any(not timer.cancelled for timer in self._timers)
            return self._running or bool(self._jobs or self._stops) or waits

    @property
    def connected(self) -> bool:
        return self._line is not None

    def _post(self, lane: deque[_Job], job: Callable[[Line], T], opens: bool = False) -> Future[T]:
        future: Future[T] = Future()
        with self._mutex:
            if self._thread is None:
                future.set_exception(self._closed())
                return future
            if self._line is None and not opens:
                future.set_exception(self._gone())
                return future
            if self._defect is not None and lane is self._jobs:  # a stop goes through all the same
                future.set_exception(self._take_defect(self._defect))
                return future
            lane.append(_Job(job, future))
        self._ring()
        return future

    def _take_defect(self, defect: BaseException) -> DeviceFault:
        self._defect = None
        fault = DeviceFault(
            self.settings.device, "what runs by the clock to end well", f"{type(defect).__name__}: {defect}",
            "report this defect; until then open the device again",
        )  # fmt: skip
        fault.__cause__ = defect
        return fault

    def _closed(self) -> DeviceLost:
        return DeviceLost(self.settings.device, "an open connection", "a closed one", "open the device first")

    def _gone(self) -> DeviceLost:
        return DeviceLost(
            self.settings.device, f"{self.settings.path} to be there",
            f"it gone for {self._clock() - self._lost_s:.1f} s ({self._lost_because})",
            "plug it in again; it is looked for until it is back",
        )  # fmt: skip

    def _ring(self) -> None:
        with self._mutex:
            if self._bell >= 0:
                os.eventfd_write(self._bell, 1)

    # --- the owner thread -------------------------------------------------------------------------------------

    def _start(self) -> None:
        self._closing = False
        self._lost_because, self._retry_s, self._retry_at_s = "", FIRST_RETRY_S, 0.0
        self._bell = os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC)
        name = f"{self.settings.device} port"
        self._thread = threading.Thread(target=self._own, args=(self._bell,), name=name, daemon=True)
        self._thread.start()

    def _own(self, bell: int) -> None:
        try:
            while not self._closing:
                if not self._work():
                    self._wait(bell)
        finally:
            self._let_go(bell)

    def _work(self) -> bool:
        """Do the next thing that is due; False when nothing is."""
        with self._mutex:
            timer = self._due_timer()
            lane = self._stops or (self._jobs if timer is None else None)
            job = lane.popleft() if lane else None
            self._running = job is not None or timer is not None
            if job is not None and timer is not None:
                heapq.heappush(self._timers, timer)
                timer = None
        try:
            if job is not None:
                self._run(job)
            elif timer is not None:
                self._run_timer(timer)
            else:
                return self._reopen_when_due()
        finally:
            self._running = False
        return True

    def _run_timer(self, timer: Timer) -> None:
        """Nobody waits for it: what goes wrong in it, but for a lost device, is told to the next who asks."""
        job: _Job = _Job(timer.job, Future())
        self._run(job)
        error = job.future.exception()
        if error is not None and not isinstance(error, DeviceLost):
            self._defect = error

    def _due_timer(self) -> Timer | None:
        while self._timers and (self._timers[0].cancelled or self._timers[0].due_s <= self._clock()):
            timer = heapq.heappop(self._timers)
            if not timer.cancelled:
                return timer
        return None

    def _run(self, job: _Job) -> None:
        if not job.future.set_running_or_notify_cancel():
            return
        self.statistics.jobs += 1
        try:
            if self._line is None:
                if self._lost_because:
                    raise self._gone()
                self._line = self._open()
            answer = job.run(self._line)
        except OSError as error:
            self._lose(error.strerror or str(error))
            job.future.set_exception(self._gone())
        except BaseException as error:  # noqa: BLE001 - the caller's, who waits for the future
            job.future.set_exception(error)
        else:
            job.future.set_result(answer)

    def _open(self) -> Line:
        line = Line(self.settings, self._keep)
        self.statistics.openings += 1
        return line

    def _keep(self, direction: Direction, data: bytes) -> None:
        if direction == "out":
            self.statistics.bytes_out += len(data)
        else:
            self.statistics.bytes_in += len(data)
        if self._trace is not None:
            self._trace.keep(self._clock(), direction, data)

    def _lose(self, because: str) -> None:
        self.statistics.losses += self._line is not None
        line = self._line
        with self._mutex:
            self._line = None
            self._lost_s, self._lost_because = self._clock(), because or "gone"
            self._retry_s = FIRST_RETRY_S
            self._retry_at_s = self._lost_s + self._retry_s
            waiting = [*self._stops, *self._jobs]
            self._stops.clear()
            self._jobs.clear()
            self._timers.clear()
        if line is not None:
            line.close()
        for job in waiting:
            if job.future.set_running_or_notify_cancel():
                job.future.set_exception(self._gone())

    def _reopen_when_due(self) -> bool:
        """Look for a lost device; True when it is back and greeted."""
        if self._line is not None or not self._lost_because or self._clock() < self._retry_at_s:
            return False
        try:
            line = self._open()
        except (DeviceError, OSError) as error:
            self._try_later(str(error))
            return False
        try:
            for greet in tuple(self._greetings.values()):
                greet(line)
        except (DeviceError, OSError) as error:
            line.close()
            self._try_later(str(error))
            return False
        with self._mutex:
            self._line, self._lost_because = line, ""
        return True

    def _try_later(self, because: str) -> None:
        self._lost_because = because
        self._retry_s = min(2.0 * self._retry_s, LONGEST_RETRY_S)
        self._retry_at_s = self._clock() + self._retry_s

    def _wait(self, bell: int) -> None:
        """Until there is something to do; bytes that nobody asked for go to ``on_bytes``."""
        line = self._line
        watched = [bell] if line is None else [bell, line.descriptor]
        try:
            ready = select.select(watched, [], [], self._patience_s())[0]
            if line is not None and line.descriptor in ready:
                data = line.read_some(0.0)
                if self._on_bytes is None:
                    self.statistics.stray_bytes += len(data)
                elif data:
                    self._on_bytes(data)
        except OSError as error:
            self._lose(error.strerror or str(error))
            return
        if bell in ready:
            with suppress(BlockingIOError):
                os.eventfd_read(bell)

    def _patience_s(self) -> float | None:
        with self._mutex:
            dues = [self._timers[0].due_s] if self._timers else []
            if self._line is None and self._lost_because:
                dues.append(self._retry_at_s)
        return max(0.0, min(dues) - self._clock()) if dues else None

    def _let_go(self, bell: int) -> None:
        with self._mutex:
            waiting = [*self._stops, *self._jobs]
            self._stops.clear()
            self._jobs.clear()
            self._timers.clear()
            line, self._line = self._line, None
            self._bell = -1
            os.close(bell)
        for job in waiting:
            if job.future.set_running_or_notify_cancel():
                job.future.set_exception(self._closed())
        if line is not None:
            line.close()


def _retrieve(future: asyncio.Future[Any]) -> None:
    """A caller that was cancelled does not ask for the outcome any more."""
    if not future.cancelled():
        future.exception()


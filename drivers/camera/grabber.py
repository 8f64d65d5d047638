"""One owner thread for one video device: it opens, grabs for ever, and opens again when the device has gone."""

from __future__ import annotations

import asyncio
import threading
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import dataclass
from typing import Any, Generic, Protocol, TypeVar

from drivers.errors import DeviceError, DeviceFault, DeviceLost, DeviceMissing

T = TypeVar("T")
D = TypeVar("D", covariant=True)


class Source(Protocol[D]):
    """An open device. ``next_frame`` blocks; it raises ``DeviceLost`` or ``DeviceTimeout`` when none comes."""

    def next_frame(self) -> D: ...

    def close(self) -> None: ...


F = TypeVar("F")
S = TypeVar("S", bound=Source[Any])

FIRST_RETRY_S = 0.2
LONGEST_RETRY_S = 5.0
JOIN_S = 2.5


@dataclass(frozen=True, slots=True, eq=False)
class Grab(Generic[F]):
    """A frame; ``grab_s`` is when it was there, in loop time."""

    grab_s: float
    data: F


@dataclass(slots=True)
class GrabberStatistics:
    """What came since the grabber was made."""

    frames: int = 0
    openings: int = 0
    losses: int = 0


class Grabber(Generic[S, F]):
    """``open_source`` opens the device, ``read`` is its ``next_frame``.

    ``on_grab`` gets every frame and ``on_trouble`` why there is none.

    All are called in the owner thread; the last frame's bytes are for the callee to keep or to forget.
    """

    def __init__(
        self,
        open_source: Callable[[], S],
        read: Callable[[S], F],
        clock: Callable[[], float],
        on_grab: Callable[[Grab[F]], None],
        on_trouble: Callable[[DeviceError], None],
    ) -> None:
        self.statistics = GrabberStatistics()
        self._open_source, self._read, self._clock = open_source, read, clock
        self._on_grab, self._on_trouble = on_grab, on_trouble
        self._jobs: deque[tuple[Callable[[S], Any], Future[Any]]] = deque()
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._own, name="camera", daemon=True)

    def start(self) -> None:
        self._thread.start()

    async def stop(self, patience_s: float = JOIN_S) -> None:
        """End the thread; one that is held up in a read for longer ends by itself when that returns."""
        self._closing.set()
        await asyncio.shield(asyncio.get_running_loop().run_in_executor(None, self._thread.join, patience_s))

    def post(self, job: Callable[[S], T]) -> Future[T]:
        """Run a job between two frames; it fails with ``DeviceLost`` when the device goes before its turn."""
        future: Future[T] = Future()
        self._jobs.append((job, future))
        return future

    def _own(self) -> None:
        retry_s = FIRST_RETRY_S
        while not self._closing.is_set():
            try:
                source = self._open_source()
            except DeviceError as error:
                self._fail(error)
                self._closing.wait(retry_s)
                retry_s = min(2.0 * retry_s, LONGEST_RETRY_S)
                continue
            self.statistics.openings += 1
            retry_s = FIRST_RETRY_S
            try:
                self._grab_from(source)
            except DeviceError as error:
                self._fail(error)
            except Exception as error:  # noqa: BLE001 - a defect must reach the caller, not end the thread unseen
                self._fail(DeviceFault("camera", "a frame", f"{type(error).__name__}: {error}", "report this defect"))
            finally:
                source.close()
            self.statistics.losses += 1
            self._closing.wait(retry_s)
        self._drop_jobs(DeviceLost("camera", "an open connection", "a closed one", "open the device first"))

    def _grab_from(self, source: S) -> None:
        while not self._closing.is_set():
            while self._jobs:
                self._run(source)
            data = self._read(source)
            self.statistics.frames += 1
            self._on_grab(Grab(self._clock(), data))

    def _run(self, source: S) -> None:
        job, future = self._jobs.popleft()
        if not future.set_running_or_notify_cancel():
            return
        try:
            future.set_result(job(source))
        except OSError as error:
            lost = DeviceLost("camera", "its controls to answer", error.strerror or str(error), "plug it in again")
            future.set_exception(lost)
            raise lost from error
        except Exception as error:  # noqa: BLE001 - the caller's, who waits for the future
            future.set_exception(error)

    def _fail(self, error: DeviceError) -> None:
        self._drop_jobs(error)
        self._on_trouble(error)

    def _drop_jobs(self, error: DeviceError) -> None:
        while self._jobs:
            _, future = self._jobs.popleft()
            if future.set_running_or_notify_cancel():
                future.set_exception(error)


def as_lost(error: DeviceError) -> DeviceError:
    """A device that is missing after it was there is lost."""
    return (
        DeviceLost(error.device, error.expected, error.found, error.remedy)
        if isinstance(error, DeviceMissing)
        else error
    )

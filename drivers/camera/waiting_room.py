"""Those who wait on the event loop for a pair that is grabbed in another thread."""

from __future__ import annotations

import asyncio
import threading
from contextlib import suppress
from dataclasses import dataclass

from drivers.camera.values import StereoFrame
from drivers.errors import DeviceError, DeviceTimeout


@dataclass(eq=False, slots=True)
class Waiting:
    """Someone who waits for a pair exposed after ``after_s``, with ``discard`` pairs yet to let pass."""

    after_s: float
    discard: int
    loop: asyncio.AbstractEventLoop
    future: asyncio.Future[StereoFrame]

    def resolve(self, outcome: StereoFrame | DeviceError) -> None:
        """From any thread."""
        with suppress(RuntimeError):  # the loop has ended, and with it whoever waited
            self.loop.call_soon_threadsafe(_resolve, self.future, outcome)


def _resolve(future: asyncio.Future[StereoFrame], outcome: StereoFrame | DeviceError) -> None:
    if future.done():
        return
    if isinstance(outcome, DeviceError):
        future.set_exception(outcome)
    else:
        future.set_result(outcome)


class WaitingRoom:
    """Every method may be called from any thread, except ``enter``, ``leave`` and ``wait`` (event loop).

    ``trouble`` is why there are no frames; as long as it lasts nobody waits, except for a silent camera.
    """

    def __init__(self) -> None:
        self._mutex = threading.Lock()
        self._waiting: list[Waiting] = []
        self._trouble: DeviceError | None = None
        self._frames = 0

    def enter(self, after_s: float, discard: int) -> Waiting:
        loop = asyncio.get_running_loop()
        waiting = Waiting(after_s, discard, loop, loop.create_future())
        with self._mutex:
            self._waiting.append(waiting)
            trouble = self._trouble
        if trouble is not None and not isinstance(trouble, DeviceTimeout):
            waiting.resolve(trouble)
        return waiting

    def leave(self, waiting: Waiting) -> None:
        with self._mutex:
            if waiting in self._waiting:
                self._waiting.remove(waiting)
        if not waiting.future.cancel() and not waiting.future.cancelled():
            waiting.future.exception()  # it has been told, or nobody asks any more

    async def wait(self, waiting: Waiting, patience_s: float, longest_s: float) -> StereoFrame | None:
        """The pair; None when no frame has come for ``patience_s``, or none that serves within ``longest_s``."""
        loop = asyncio.get_running_loop()
        end_s = loop.time() + longest_s
        while True:
            frames = self._frames
            done, _ = await asyncio.wait({waiting.future}, timeout=patience_s)
            if done:
                return waiting.future.result()
            if self._frames == frames or loop.time() > end_s:
                return None

    def served(self, grab_s: float, begin_s: float, valid: bool) -> list[Waiting]:
        """Who gets the pair that was there at ``grab_s`` and exposed from ``begin_s`` on; they leave with it.

        ``valid``: it was exposed with the settings that hold.
        """
        with self._mutex:
            self._trouble = None
            self._frames += 1
            served = [waiting for waiting in self._waiting if _serves(waiting, grab_s, begin_s, valid)]
            self._waiting = [waiting for waiting in self._waiting if waiting not in served]
        return served

    def clear(self) -> None:
        """There is no trouble any more."""
        with self._mutex:
            self._trouble = None

    def fail(self, trouble: DeviceError) -> None:
        """Tell all; a camera that is only silent may yet come back, so those who wait wait on."""
        with self._mutex:
            self._trouble = trouble
            if isinstance(trouble, DeviceTimeout):
                return
            waiting, self._waiting = self._waiting, []
        for one in waiting:
            one.resolve(trouble)


def _serves(waiting: Waiting, grab_s: float, begin_s: float, valid: bool) -> bool:
    """Whether the pair was exposed after the call: by its place in the stream, and by the clock."""
    if waiting.discard > 0:
        waiting.discard -= grab_s > waiting.after_s
        return False
    return valid and begin_s >= waiting.after_s

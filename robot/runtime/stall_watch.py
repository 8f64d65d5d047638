"""The thread that stops the machine while the event loop stands still."""

from __future__ import annotations

import asyncio
import logging
import sys
import threading
import traceback
from collections.abc import Callable, Sequence
from concurrent.futures import Future, wait
from types import TracebackType

from drivers.errors import DeviceError, DeviceFault
from drivers.stop_lane import StopLane
from robot.runtime.devices import Devices
from robot.runtime.stall import Look, StallJudge, StallRules
from robot.safety.timing import CLOSE_DEADLINE_S

TAKEN_S = 0.15  # the owner of a port takes a stop within this time, or it hangs
JOIN_S = 3.0
CAUSE = "the event loop stalled"

_log = logging.getLogger(__name__)


def stop_lanes(devices: Devices) -> tuple[StopLane, ...]:
    """Of what sprays first, then of what moves; simulated devices have none."""
    lanes = (devices.relay.stop_lane, devices.wheels.stop_lane, devices.arm.stop_lane)
    return tuple(lane for lane in lanes if lane is not None)


class StallWatch:
    """Watches the running loop from ``__enter__`` to ``__exit__``; the loop owes it a ``beat`` every ``beat_s``.

    When the loop stalls, every lane gets its stop, by force where the owner of a port does not take it, and the stacks
    of all threads go to the log. When the loop is back ``on_stall`` is called on it, before anything that fell due
    meanwhile, with the seconds without a beat; the devices obey again after ``release``.
    """

    def __init__(
        self, lanes: Sequence[StopLane], on_stall: Callable[[float], None], rules: StallRules | None = None
    ) -> None:
        self._lanes, self._on_stall, self._rules = tuple(lanes), on_stall, rules or StallRules()
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._watch, name="stall watch", daemon=True)

    def __enter__(self) -> StallWatch:
        self._loop = asyncio.get_running_loop()
        self._beat_s = self._loop.time()
        self._stopped = asyncio.Event()
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._end.set()
        self._thread.join(JOIN_S)
        for lane in self._lanes:
            lane.release()

    @property
    def beat_s(self) -> float:
        """The pause between two beats, seconds."""
        return self._rules.beat_s

    async def beat(self) -> None:
        """The loop lives. ``DeviceFault`` when the watch itself does not."""
        self._beat_s = self._loop.time()
        if not self._thread.is_alive():
            raise DeviceFault("stall watch", "its thread to run", "it ended", "restart the program, report this defect")

    async def release(self) -> None:
        """After ``on_stall``: the stop is latched. Waits until the last of the devices has got its stop."""
        await self._stopped.wait()
        for lane in self._lanes:
            lane.release()

    def _back(self, beat_s: float) -> None:
        """The loop runs again; its last beat before the stall was at ``beat_s``."""
        self._stopped.clear()
        if not self._end.is_set():
            self._on_stall(self._loop.time() - beat_s)

    # --- in the thread

    def _watch(self) -> None:
        judge = StallJudge(self._rules, self._loop.time())
        while not self._end.wait(self._rules.look_s):
            beat_s = self._beat_s
            if judge.look(self._loop.time(), beat_s) is Look.STALLED:
                self._loop.call_soon_threadsafe(self._back, beat_s)
                problems = stop_all(self._lanes, CAUSE)
                self._loop.call_soon_threadsafe(self._stopped.set)
                _log.critical(
                    "%s for %.2f s: all-off was sent to %s%s; the threads stand here:\n%s",
                    CAUSE, self._loop.time() - beat_s, ", ".join(lane.device for lane in self._lanes) or "nothing",
                    "".join(f" ({problem})" for problem in problems), stacks(),
                )  # fmt: skip


def stop_all(lanes: Sequence[StopLane], because: str) -> tuple[str, ...]:
    """Stop every device from this thread; what went wrong, and what had to be forced. Ends within two deadlines."""
    posted = [(lane, lane.post(because)) for lane in lanes]
    wait((stop for _, stop in posted), TAKEN_S)
    hanging = [(lane, stop) for lane, stop in posted if not (stop.running() or stop.done())]
    problems = [_forced(lane) for lane, _ in hanging]
    rest = [(lane, stop) for lane, stop in posted if (lane, stop) not in hanging]
    wait((stop for _, stop in rest), CLOSE_DEADLINE_S - TAKEN_S)
    problems += [_forced(lane) if not stop.done() else _error_of(lane, stop) for lane, stop in rest]
    return tuple(problem for problem in problems if problem)


def _forced(lane: StopLane) -> str:
    try:
        written = lane.force()
    except (DeviceError, OSError) as error:
        return f"{lane.device}: the owner of its port hangs, and beside it: {error}"
    how = "the stop was written beside it" if written else "it stops by itself, since it hears nothing"
    return f"{lane.device}: the owner of its port hangs, {how}"


def _error_of(lane: StopLane, stop: Future[None]) -> str:
    error = stop.exception()
    return "" if error is None else str(error) or f"{lane.device}: {type(error).__name__}"


def stacks() -> str:
    """Where every thread of this process stands."""
    names = {thread.ident: thread.name for thread in threading.enumerate()}
    return "\n".join(
        f"{names.get(ident, ident)}:\n{''.join(traceback.format_stack(frame)).rstrip()}"
        for ident, frame in sys._current_frames().items()
    )

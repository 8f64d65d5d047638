"""One life of the robot's program in virtual time, with all its misfortunes, from boot to end or to its killing."""

from __future__ import annotations

import asyncio
import shutil
import signal
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

from drivers.errors import DeviceError
from drivers.relay.values import Channel
from robot.clock import VirtualClockLoop
from robot.errors import SprayerError
from robot.mission import ShotDone, State
from robot.runtime import RunOptions, RunResult, StopSignals, ledger_path, run_robot
from robot.soak.composition import RowOfPlants, config_path
from robot.soak.machine_line import MachineLine
from robot.soak.misfortunes import Kind, Misfortunes, Mishap
from robot.soak.monitors import Bench
from robot.soak.values import Line
from robot.soak.watch import Watch, WatchedBus
from robot.vision.detector import Detector

LONGEST_LIFE_S = 3600.0
UNWINDING_S = 300.0
START_UTC = datetime(2026, 6, 15, 8, 0, tzinfo=UTC)


@dataclass(frozen=True, slots=True)
class LifeEnd:
    """``result`` None: it never came up (``error``), or it was killed. ``lasted_s`` in its own clock."""

    result: RunResult | None
    killed: bool
    error: str
    lasted_s: float
    shots: int

    @property
    def row_done(self) -> bool:
        return self.result is not None and self.result.state is State.DONE

    @property
    def kind(self) -> str:
        if self.killed:
            return "killed"
        if self.result is None:
            return "went down with an error"
        return "row done" if self.row_done else f"stopped ({self.result.mode})"


class WallClock:
    """The time of day by a clock that people and networks set."""

    def __init__(self) -> None:
        self._step_s = 0.0
        self._seconds: Callable[[], float] = lambda: 0.0

    def runs_by(self, seconds: Callable[[], float]) -> None:
        self._seconds = seconds

    def step(self, by_s: float) -> None:
        self._step_s += by_s

    def utc(self) -> datetime:
        return START_UTC + timedelta(seconds=self._seconds() + self._step_s)


class Life:
    """``folder`` holds the ledger; ``after_kill`` is where its files are copied as they lie at the kill."""

    def __init__(
        self, row: RowOfPlants, detector: Detector, folder: Path, after_kill: Path, misfortunes: Misfortunes,
        watch: Watch, bench: Bench, wall: WallClock,
    ) -> None:  # fmt: skip
        self._row, self._detector, self._folder, self._after_kill = row, detector, folder, after_kill
        self._misfortunes, self._watch, self._bench, self._wall = misfortunes, watch, bench, wall
        self._line = MachineLine(row.twin)
        self._signals = StopSignals()
        self._loop = VirtualClockLoop(threads=False)
        self._killed: asyncio.Future[None] = self._loop.create_future()
        self._killed_s = 0.0
        self._shots = 0

    def run(self, resume: bool, most_s: float) -> LifeEnd:
        """From here to the end, or until it is told to end (SIGTERM) after ``most_s``; exceptions that are defects are
        reported to the court as "tasks"."""
        self._loop.set_exception_handler(self._unheard)
        self._wall.runs_by(lambda: self._watch.origin_s + self._loop.time())
        self._watch.listeners.append(self._listen)
        try:
            with asyncio.Runner(loop_factory=lambda: self._loop) as runner:
                return runner.run(self._live(resume, most_s))
        finally:
            self._watch.listeners.remove(self._listen)

    async def _live(self, resume: bool, most_s: float) -> LifeEnd:
        bus = WatchedBus(self._bench, self._watch.origin_s, lambda: not self._line.cut)
        done = bus.subscribe(ShotDone)
        options = RunOptions(config_path(), self._folder, start=True, resume=resume, truth=None)
        robot = asyncio.create_task(
            run_robot(
                self._row.config, options, bus, detector=self._detector, twin=self._line.as_twin(),
                signals=self._signals, utc=self._wall.utc,
            ),
            name="robot",
        )  # fmt: skip
        closing_time = Mishap(Kind.TERMINATED, most_s)
        others = [
            asyncio.create_task(self._happen(mishap)) for mishap in (*self._misfortunes.mishaps, closing_time)
        ]  # fmt: skip
        try:
            await asyncio.wait((robot, self._killed), return_when=asyncio.FIRST_COMPLETED, timeout=LONGEST_LIFE_S)
        except asyncio.CancelledError:  # Ctrl-C: the robot goes down clean, then the soak ends
            await _ended(robot)
            raise
        finally:
            for other in others:
                other.cancel()
        if not self._killed.done() and not robot.done():
            self._bench.court.report("alive", f"a life of {LONGEST_LIFE_S:.0f} s had no end")
            self._kill()
        if self._killed.done():
            await _ended(robot)
            return LifeEnd(None, True, "", self._killed_s, len(done.drain()))
        lasted_s, shots = self._loop.time(), len(done.drain())
        try:
            return LifeEnd(robot.result(), False, "", lasted_s, shots)
        except (SprayerError, DeviceError) as error:
            return LifeEnd(None, False, str(error), lasted_s, shots)
        except Exception as error:  # noqa: BLE001 - told as a violation, not dropped
            return LifeEnd(None, False, self._judge(error), lasted_s, shots)

    def _judge(self, error: BaseException) -> str:
        """Errors for people may come in a group of tasks; anything else is a defect of the program."""
        defects = [leaf for leaf in _leaves(error) if not isinstance(leaf, SprayerError | DeviceError)]
        if defects:
            self._bench.court.report("tasks", f"the program died of {type(defects[0]).__name__}: {defects[0]}")
        return "; ".join(str(leaf) for leaf in _leaves(error))

    async def _happen(self, mishap: Mishap) -> None:
        await asyncio.sleep(mishap.at_s)
        match mishap.kind:
            case Kind.KILLED:
                self._kill()
            case Kind.TERMINATED:
                self._signals.take(signal.SIGTERM)
            case Kind.CLOCK:
                self._wall.step(mishap.step_s)
        for after_s, command in mishap.commands:
            await asyncio.sleep(max(0.0, mishap.at_s + after_s - self._loop.time()))
            self._row.twin.apply(self._loop.time(), command)

    def _listen(self, line: Line) -> None:
        if line.what != "coil_on" or line.detail["channel"] != Channel.VALVE.value:
            return
        self._shots += 1
        for mishap in self._misfortunes.mishaps:
            if mishap.kind is Kind.KILLED_IN_SHOT and mishap.shots == self._shots:
                self._loop.call_later(mishap.into_s, self._kill)

    def _kill(self) -> None:
        """From this moment on nothing of the process reaches machine, ledger or monitors."""
        if self._killed.done() or self._loop.is_closed():
            return
        self._line.cut = True
        self._killed_s = self._loop.time()
        self._killed.set_result(None)
        self._row.twin.advance(self._killed_s)
        self._after_kill.mkdir(parents=True)
        ledger = ledger_path(self._folder)
        for file in (ledger, ledger.with_name(f"{ledger.name}-wal")):
            if file.exists():
                shutil.copyfile(file, self._after_kill / file.name)
        self._bench.killed(self._watch.origin_s + self._killed_s)

    def _unheard(self, _loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
        if not self._line.cut:
            self._bench.court.report("tasks", f"{context.get('message')}: {context.get('exception')!r}")


async def _ended(robot: asyncio.Task[RunResult]) -> None:
    """Its end is waited for; how it went no longer matters to anybody."""
    robot.cancel()
    done, _ = await asyncio.wait((robot,), timeout=UNWINDING_S)
    if not done:
        raise RuntimeError(f"the robot's program did not end within {UNWINDING_S:.0f} s of being told to")
    if not robot.cancelled():
        robot.exception()


def _leaves(error: BaseException) -> list[BaseException]:
    if isinstance(error, BaseExceptionGroup):
        return [leaf for inner in error.exceptions for leaf in _leaves(inner)]
    return [error]

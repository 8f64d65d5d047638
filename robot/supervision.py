"""Every long-lived task has an owner and an expected rate; a dead or silent one is a fault, never a log line."""

from __future__ import annotations

import asyncio
import math
from collections import deque
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, replace
from enum import StrEnum

from drivers.errors import DeviceError

FIRST_RETRY_S = 0.2
LONGEST_RETRY_S = 5.0
LOOK_EVERY_S = 0.1
LONGEST_WITHOUT_A_LOOK_S = 2.0
RATE_OVER_BEATS = 50


class Health(StrEnum):
    STARTING = "starting"
    READY = "ready"
    DEGRADED = "degraded"
    FAILED = "failed"
    STOPPED = "stopped"


@dataclass(frozen=True, slots=True)
class TaskHealth:
    """One line of the health tree; times are of the loop.

    ``expected_hz`` and ``longest_silence_s`` are 0 and infinite for a task that waits for events. ``since_s`` is when
    ``state`` began, ``beat_s`` the last step that went well, ``alive_s`` the last sign of life, a failure included.
    ``last_error`` is the newest, of ``error_s``; "" when there never was one.
    """

    name: str
    owner: str
    expected_hz: float
    longest_silence_s: float
    state: Health
    since_s: float
    beat_s: float
    alive_s: float
    last_error: str = ""
    error_s: float = -math.inf
    beats: int = 0
    errors: int = 0
    measured_hz: float = 0.0


Fault = Callable[[str, str], None]


class Supervisor:
    """Runs tasks, retries those that lose their device, and reports each that fails or falls silent.

    ``on_fault(name, text)`` is called when a task degrades (its device fails), falls silent, or dies.
    """

    def __init__(self, group: asyncio.TaskGroup, on_fault: Fault) -> None:
        self._group = group
        self._on_fault = on_fault
        self._tasks: dict[str, TaskHealth] = {}
        self._beats: dict[str, deque[float]] = {}
        self._running: list[asyncio.Task[None]] = []
        self._looked_s: float | None = None

    @property
    def health(self) -> tuple[TaskHealth, ...]:
        """Every task that was ever started here, in that order."""
        return tuple(replace(task, measured_hz=self._measured_hz(task)) for task in self._tasks.values())

    def healthy(self) -> str:
        """The reason why the process should be started anew; "" while every task gives signs of life.

        A task whose device is gone tries again, and so is alive: a new process would not bring the device back.
        """
        now_s = asyncio.get_running_loop().time()
        if self._looked_s is not None and now_s - self._looked_s > LONGEST_WITHOUT_A_LOOK_S:
            return f"supervisor: has not looked after its tasks for {now_s - self._looked_s:.1f} s"
        for task in self._tasks.values():
            if task.state is Health.FAILED:
                return f"{task.name} ({task.owner}): {task.last_error}"
            between_tries_s = LONGEST_RETRY_S if task.alive_s > task.beat_s else 0.0
            silent_s = now_s - task.alive_s
            if task.state is not Health.STOPPED and silent_s > task.longest_silence_s + between_tries_s:
                return f"{task.name} ({task.owner}): no sign of life for {silent_s:.1f} s"
        return ""

    def poll(
        self, name: str, owner: str, step: Callable[[], Awaitable[None]], period_s: float, longest_silence_s: float
    ) -> None:
        """Run ``step`` every ``period_s`` while the group lives; a ``DeviceError`` is retried with back-off.

        With ``period_s`` 0 the step itself waits for what comes, at the least every ``longest_silence_s``.
        """
        self._register(name, owner, 1.0 / (period_s or longest_silence_s), longest_silence_s)
        self._running.append(self._group.create_task(self._run(name, step, period_s), name=name))

    def keep(self, name: str, owner: str, main: Callable[[], Awaitable[None]]) -> asyncio.Task[None]:
        """Run a task that waits for events and has no rate. Its end is no fault; its error ends the group."""
        self._register(name, owner, 0.0, math.inf)
        task = self._group.create_task(self._keep(name, main), name=name)
        self._running.append(task)
        task.add_done_callback(self._running.remove)
        return task

    def watch(self) -> None:
        """Start the task that notices silence."""
        self._looked_s = asyncio.get_running_loop().time()
        self._running.append(self._group.create_task(self._watch(), name="supervisor"))

    def stop(self) -> None:
        """End every task that was started here."""
        for task in tuple(self._running):
            task.cancel()

    def _register(self, name: str, owner: str, expected_hz: float, longest_silence_s: float) -> None:
        now_s = asyncio.get_running_loop().time()
        self._beats[name] = deque(maxlen=RATE_OVER_BEATS)
        self._tasks[name] = TaskHealth(
            name, owner, expected_hz, longest_silence_s, Health.STARTING, now_s, now_s, now_s
        )

    async def _run(self, name: str, step: Callable[[], Awaitable[None]], period_s: float) -> None:
        retry_s = FIRST_RETRY_S
        try:
            while True:
                try:
                    await step()
                except DeviceError as error:
                    self._fail(name, Health.DEGRADED, str(error))
                    await asyncio.sleep(retry_s)
                    retry_s = min(2 * retry_s, LONGEST_RETRY_S)
                    continue
                retry_s = FIRST_RETRY_S
                self._beat(name)
                await asyncio.sleep(period_s)
        except asyncio.CancelledError:
            self._enter(name, Health.STOPPED)
            raise
        except BaseException as error:
            self._fail(name, Health.FAILED, f"{type(error).__name__}: {error}")
            raise

    async def _keep(self, name: str, main: Callable[[], Awaitable[None]]) -> None:
        self._beat(name)
        try:
            await main()
        except asyncio.CancelledError:
            self._enter(name, Health.STOPPED)
            raise
        except BaseException as error:
            self._note_error(name, f"{type(error).__name__}: {error}")
            self._enter(name, Health.FAILED, told=True)
            raise
        self._enter(name, Health.STOPPED)

    async def _watch(self) -> None:
        while True:
            await asyncio.sleep(LOOK_EVERY_S)
            now_s = self._looked_s = asyncio.get_running_loop().time()
            for task in tuple(self._tasks.values()):
                silent = now_s - task.beat_s > task.longest_silence_s
                if silent and task.state in (Health.STARTING, Health.READY):
                    self._note_error(task.name, f"silent for {now_s - task.beat_s:.1f} s")
                    self._enter(task.name, Health.DEGRADED)

    def _beat(self, name: str) -> None:
        now_s = asyncio.get_running_loop().time()
        task = self._tasks[name]
        since_s = task.since_s if task.state is Health.READY else now_s
        self._beats[name].append(now_s)
        self._tasks[name] = replace(
            task, state=Health.READY, since_s=since_s, beat_s=now_s, alive_s=now_s, beats=task.beats + 1
        )

    def _fail(self, name: str, state: Health, text: str) -> None:
        """The task itself says that something went wrong: it is alive."""
        self._tasks[name] = replace(self._tasks[name], alive_s=asyncio.get_running_loop().time())
        self._note_error(name, text)
        self._enter(name, state)

    def _note_error(self, name: str, text: str) -> None:
        task = self._tasks[name]
        now_s = asyncio.get_running_loop().time()
        self._tasks[name] = replace(task, last_error=text, error_s=now_s, errors=task.errors + 1)

    def _enter(self, name: str, state: Health, told: bool = False) -> None:
        task = self._tasks[name]
        if task.state is state:
            return
        self._tasks[name] = replace(task, state=state, since_s=asyncio.get_running_loop().time())
        if state in (Health.DEGRADED, Health.FAILED) and not told:
            self._on_fault(name, task.last_error)

    def _measured_hz(self, task: TaskHealth) -> float:
        """Over the newest beats, and falling from the moment at which one is overdue."""
        beats = self._beats[task.name]
        if task.expected_hz == 0.0 or len(beats) < 2 or task.state is Health.STOPPED:
            return 0.0
        mean_s = (beats[-1] - beats[0]) / (len(beats) - 1)
        late_s = asyncio.get_running_loop().time() - beats[-1]
        return 1.0 / max(mean_s, late_s / 2, 1e-6)

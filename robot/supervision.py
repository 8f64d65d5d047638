"""Every long-lived task has an owner and an expected rate; a dead or silent one is a fault, never a log line."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, replace
from enum import StrEnum

from drivers.errors import DeviceError

FIRST_RETRY_S = 0.2
LONGEST_RETRY_S = 5.0
SILENT = "silent for"


class Health(StrEnum):
    STARTING = "starting"
    READY = "ready"
    DEGRADED = "degraded"
    FAILED = "failed"
    STOPPED = "stopped"


@dataclass(frozen=True, slots=True)
class TaskHealth:
    """One line of the health tree. ``since_s`` is when ``state`` began, ``beat_s`` the last sign of life."""

    name: str
    owner: str
    longest_silence_s: float
    state: Health
    since_s: float
    beat_s: float
    last_error: str


Fault = Callable[[str, str], None]


class Supervisor:
    """Runs polling tasks, retries those that lose their device, and reports each that fails or falls silent.

    ``on_fault(name, text)`` is called when a task degrades (its device fails), falls silent, or dies.
    """

    def __init__(self, group: asyncio.TaskGroup, on_fault: Fault) -> None:
        self._group = group
        self._on_fault = on_fault
        self._tasks: dict[str, TaskHealth] = {}
        self._running: list[asyncio.Task[None]] = []

    @property
    def health(self) -> tuple[TaskHealth, ...]:
        return tuple(self._tasks.values())

    def healthy(self) -> str:
        """The reason why the process should be started anew; "" while every task gives signs of life.

        A task whose device is gone tries again, and so is alive: a new process would not bring the device back.
        """
        now_s = asyncio.get_running_loop().time()
        for task in self._tasks.values():
            silent_s = now_s - task.beat_s
            if task.state is Health.FAILED:
                return f"{task.name} ({task.owner}): {task.last_error}"
            if task.last_error.startswith(SILENT) and silent_s > task.longest_silence_s + LONGEST_RETRY_S:
                return f"{task.name} ({task.owner}): no sign of life for {silent_s:.1f} s"
        return ""

    def poll(
        self, name: str, owner: str, step: Callable[[], Awaitable[None]], period_s: float, longest_silence_s: float
    ) -> None:
        """Run ``step`` every ``period_s`` while the group lives; a ``DeviceError`` is retried with back-off."""
        now_s = asyncio.get_running_loop().time()
        self._tasks[name] = TaskHealth(name, owner, longest_silence_s, Health.STARTING, now_s, now_s, "")
        self._running.append(self._group.create_task(self._run(name, step, period_s), name=name))

    def watch(self) -> None:
        """Start the task that notices silence."""
        self._running.append(self._group.create_task(self._watch(), name="supervisor"))

    def stop(self) -> None:
        """End every task that was started here."""
        for task in self._running:
            task.cancel()

    async def _run(self, name: str, step: Callable[[], Awaitable[None]], period_s: float) -> None:
        retry_s = FIRST_RETRY_S
        try:
            while True:
                try:
                    await step()
                except DeviceError as error:
                    self._enter(name, Health.DEGRADED, str(error))
                    await asyncio.sleep(retry_s)
                    retry_s = min(2 * retry_s, LONGEST_RETRY_S)
                    continue
                retry_s = FIRST_RETRY_S
                self._beat(name)
                await asyncio.sleep(period_s)
        except asyncio.CancelledError:
            self._enter(name, Health.STOPPED, "")
            raise
        except BaseException as error:
            self._enter(name, Health.FAILED, f"{type(error).__name__}: {error}")
            raise

    async def _watch(self) -> None:
        while True:
            await asyncio.sleep(0.1)
            now_s = asyncio.get_running_loop().time()
            for task in self.health:
                silent = now_s - task.beat_s > task.longest_silence_s
                if silent and task.state in (Health.STARTING, Health.READY):
                    self._enter(task.name, Health.DEGRADED, f"{SILENT} {now_s - task.beat_s:.1f} s")

    def _beat(self, name: str) -> None:
        now_s = asyncio.get_running_loop().time()
        task = self._tasks[name]
        since_s = task.since_s if task.state is Health.READY else now_s
        self._tasks[name] = replace(task, state=Health.READY, since_s=since_s, beat_s=now_s)

    def _enter(self, name: str, state: Health, error: str) -> None:
        task = self._tasks[name]
        if task.state is state:
            return
        now_s = asyncio.get_running_loop().time()
        self._tasks[name] = replace(task, state=state, since_s=now_s, last_error=error or task.last_error)
        if state in (Health.DEGRADED, Health.FAILED):
            self._on_fault(name, error)

"""Runs the mission of a task over pauses to its end, or to a stop; one at a time."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from robot import safety
from robot.mission import Mission, MissionContext, State
from robot.runtime.tasks import OpenTask, Tasks
from robot.safety import Mode
from robot.supervision import Supervisor

WIND_DOWN_S = 5.0


class Rows:
    """``make_context`` gives a mission what it needs; ``done`` is called when a row came to its end."""

    def __init__(self, tasks: Tasks, make_context: Callable[[OpenTask], MissionContext]) -> None:
        self._tasks, self._make_context = tasks, make_context
        self._mission: Mission | None = None
        self._context: MissionContext | None = None
        self._running: asyncio.Task[None] | None = None
        self._mode_moved = asyncio.Event()
        self._at_rest = asyncio.Event()
        self._at_rest.set()
        self.state = State.IDLE

    @property
    def running(self) -> bool:
        """Whether a mission is under way, paused ones included."""
        return self._running is not None and not self._running.done()

    def mode_changed(self, state: safety.SafetyState) -> None:
        self._mode_moved.set()
        if self._mission is not None:
            self._mission.mode_changed(state)

    def begin(self, supervisor: Supervisor, task: OpenTask) -> asyncio.Task[None]:
        """Start the mission; the mode is AUTO already."""
        self._context = self._make_context(task)
        self._mission = Mission(self._context)
        self._at_rest.clear()
        self._running = supervisor.keep("mission", "mission", lambda: self._run(task))
        return self._running

    async def at_rest(self) -> bool:
        """Wait until nothing of the mission acts any more, which the mode forbids already; False if that takes long."""
        try:
            async with asyncio.timeout(WIND_DOWN_S):
                await self._at_rest.wait()
        except TimeoutError:
            return False
        return True

    async def ended(self) -> State:
        """Wait for the end of the mission that runs, and give its last state; what ended it badly is raised."""
        if self._running is not None:
            await self._running
        return self.state

    async def _run(self, task: OpenTask) -> None:
        assert self._mission is not None
        assert self._context is not None
        actuation = self._context.actuation
        try:
            while True:
                self.state = await self._once(self._mission)
                if self.state is State.DONE:
                    task.done = True
                    for verb in (safety.Verb.FINISH, safety.Verb.DISARM):
                        actuation.change_mode(verb, "the row is done")
                    await actuation.de_energise()
                    return
                self._at_rest.set()
                while actuation.state.mode is Mode.PAUSED:
                    self._mode_moved.clear()
                    await self._mode_moved.wait()
                if actuation.state.mode is not Mode.AUTO:
                    return
                self._at_rest.clear()
                await self._tasks.rewind(task)
        finally:
            self._at_rest.set()

    async def _once(self, mission: Mission) -> State:
        try:
            return await mission.run()
        except asyncio.CancelledError:
            me = asyncio.current_task()
            if me is None or me.cancelling():
                raise
            return State.IDLE  # paused and resumed before the state's task had ended: it begins anew

"""Runs the mission of a task to its end, or to a stop; one at a time."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from robot import safety
from robot.mission import Mission, MissionContext, State
from robot.runtime.tasks import OpenTask
from robot.supervision import Supervisor

WIND_DOWN_S = 5.0


class Rows:
    """``make_context`` gives a mission what it needs."""

    def __init__(self, make_context: Callable[[OpenTask], MissionContext]) -> None:
        self._make_context = make_context
        self._mission: Mission | None = None
        self._running: asyncio.Task[None] | None = None
        self.state = State.IDLE

    @property
    def running(self) -> bool:
        """Whether a mission is under way, paused ones included."""
        return self._running is not None and not self._running.done()

    def mode_changed(self, state: safety.SafetyState) -> None:
        if self._mission is not None:
            self._mission.mode_changed(state)

    def begin(self, supervisor: Supervisor, task: OpenTask) -> asyncio.Task[None]:
        """Start the mission; the mode is AUTO already."""
        context = self._make_context(task)
        mission = self._mission = Mission(context)
        self._running = supervisor.keep("mission", "mission", lambda: self._run(mission, context, task))
        return self._running

    async def wound_down(self) -> bool:
        """Wait for the end of a mission whose mode was taken away; False when that takes too long."""
        if self._running is not None:
            await asyncio.wait((self._running,), timeout=WIND_DOWN_S)
        return not self.running

    async def ended(self) -> None:
        """Wait for the end of the mission that runs; what ended it badly is raised."""
        if self._running is not None:
            await self._running

    async def _run(self, mission: Mission, context: MissionContext, task: OpenTask) -> None:
        self.state = await mission.run()
        if self.state is State.DONE:
            task.done = True
            for verb in (safety.Verb.FINISH, safety.Verb.DISARM):
                context.actuation.change_mode(verb, "the row is done")
            await context.actuation.de_energise()

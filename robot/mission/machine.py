"""Runs the state machine: one cancellable task a state, transitions from the table, no state without a reason."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable

from drivers.errors import DeviceError
from robot import safety
from robot.errors import SprayerError
from robot.mission.aim import aim
from robot.mission.context import MissionContext
from robot.mission.detect import detect
from robot.mission.device_faults import fault_of_error
from robot.mission.events import StateEntered, Trouble
from robot.mission.move import move
from robot.mission.spray import spray
from robot.mission.stop import stop
from robot.mission.transitions import Event, State, next_state

StateTask = Callable[[MissionContext], Awaitable[Event]]

STATE_TASKS: dict[State, StateTask] = {
    State.MOVE: move,
    State.STOP: stop,
    State.DETECT: detect,
    State.AIM: aim,
    State.SPRAY: spray,
}


class Mission:
    """One pass over a route. ``run`` returns DONE, or IDLE when it was halted; it can be run again to go on.

    A pause is waited out: the route goes on from MOVE when the mode is AUTO again.
    """

    def __init__(self, context: MissionContext) -> None:
        self._context = context
        self._task: asyncio.Task[Event] | None = None
        self._mode_moved = asyncio.Event()
        self.state = State.IDLE

    def mode_changed(self, state: safety.SafetyState) -> None:
        """Leaving AUTO cancels the state's task."""
        self._mode_moved.set()
        if state.mode is not safety.Mode.AUTO and self._task is not None:
            self._task.cancel()

    async def run(self) -> State:
        self.state, reason = State.IDLE, "start"
        event = Event.STARTED
        while True:
            self.state = next_state(self.state, event)
            if not await self._enter(reason):
                self.state = State.IDLE
            if self.state is State.IDLE and await self._resumed():
                event, reason = Event.STARTED, "resumed"
                continue
            if self.state not in STATE_TASKS:
                return self.state
            event = await self._run_state(STATE_TASKS[self.state])
            reason = str(event)

    async def _resumed(self) -> bool:
        """Wait while the machine is paused; whether it is in AUTO again. A pause that nobody ends becomes a stop."""
        if not (self._paused() or self._in_auto()):  # AUTO: resumed before the halted state had come to its end
            return False
        actuation, longest_s = self._context.actuation, self._context.settings.longest_pause_s
        try:
            async with asyncio.timeout(longest_s):
                while self._paused():
                    self._mode_moved.clear()
                    await self._mode_moved.wait()
        except TimeoutError:
            await actuation.stop(f"paused for {longest_s:.0f} s: {'; '.join(actuation.state.causes)}")
        if not self._in_auto():
            return False
        try:
            await self._context.rewind()
        except SprayerError as error:
            await self._stop_for(error)
        return self._in_auto()

    async def _enter(self, reason: str) -> bool:
        """Tell and write down; False, and everything stopped, when the ledger cannot be written."""
        context = self._context
        context.publish(
            StateEntered(self.state, reason, context.now_s(), context.progress.stop, len(context.settings.row.stops))
        )
        try:
            await context.record("state", f"{self.state} ({reason})")
        except SprayerError as error:
            await self._stop_for(error)
            return False
        return True

    async def _run_state(self, state_task: StateTask) -> Event:
        if not self._in_auto():
            return Event.HALTED
        self._task = asyncio.create_task(_as_coroutine(state_task(self._context)), name=f"state {self.state}")
        try:
            return await self._task
        except asyncio.CancelledError:
            me = asyncio.current_task()
            if me is None or me.cancelling():
                raise  # the whole mission is being cancelled, not just the state
            return Event.HALTED
        except (DeviceError, SprayerError) as error:
            await self._stop_for(error)
            return Event.HALTED
        finally:
            if not self._task.done():
                self._task.cancel()
            self._task = None

    async def _stop_for(self, error: Exception) -> None:
        self._context.publish(Trouble(str(error), self._context.now_s()))
        text = f"{self.state}: {error}"
        if isinstance(error, DeviceError):
            await self._context.actuation.report(fault_of_error(error), text)
        if self._in_auto():
            await self._context.actuation.stop(text)

    def _paused(self) -> bool:
        return self._context.actuation.state.mode is safety.Mode.PAUSED

    def _in_auto(self) -> bool:
        return self._context.actuation.state.mode is safety.Mode.AUTO


async def _as_coroutine(awaitable: Awaitable[Event]) -> Event:
    return await awaitable

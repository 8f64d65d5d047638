"""How the robot is, put together for whoever asks: from safety, supervision, the mission's events and the ledger."""

from __future__ import annotations

import asyncio
from collections import Counter

from robot import safety
from robot.actuation import LEDGER_WRITE_S
from robot.clock import work
from robot.control import FaultNow, LedgerNow, MissionNow, PortCounts, Status
from robot.errors import SprayerError
from robot.events import Bus
from robot.ledger import Ledger
from robot.ledger.values import Outcome
from robot.mission import State, StateEntered, Trouble
from robot.runtime.lateness import LoopLateness
from robot.runtime.ports import Ports
from robot.runtime.tasks import Tasks
from robot.runtime.upkeep import Upkeep
from robot.safety import Mode

LEDGER_ANSWER_S = 1.0


class StateReport:
    """Asks nobody who could be busy, but the ledger, which has ``LEDGER_ANSWER_S``."""

    def __init__(
        self, name: str, stops: int, upkeep: Upkeep, tasks: Tasks, ledger: Ledger, ports: Ports, bus: Bus
    ) -> None:
        self._name, self._stops = name, stops
        self._upkeep, self._tasks, self._ledger, self._ports, self._bus = upkeep, tasks, ledger, ports, bus
        self._entered = bus.subscribe(StateEntered, newest_only=True)
        self._last: StateEntered | None = None
        self._mode, self._mode_since_s = Mode.DISARMED, 0.0
        self.lateness = LoopLateness()

    def mode_changed(self, state: safety.SafetyState) -> None:
        if state.mode is not self._mode:
            self._mode, self._mode_since_s = state.mode, _now_s()

    async def status(self) -> Status:
        actuation, supervisor = self._upkeep.actuation, self._upkeep.supervisor
        state = actuation.state
        return Status(
            robot=self._name,
            now_s=_now_s(),
            mode=state.mode,
            mode_since_s=self._mode_since_s,
            causes=state.causes,
            faults=tuple(FaultNow(fault.id, fault.text, fault.since_s) for fault in state.faults),
            mission=self._mission(),
            ledger=await self._sums(),
            tank_left_ml=actuation.tank_left_ml if self._tasks.current is not None else None,
            tasks=supervisor.health if supervisor is not None else (),
            unhealthy=supervisor.healthy() if supervisor is not None else "",
        )

    def ports(self) -> tuple[PortCounts, ...]:
        return tuple(PortCounts(device, counts) for device, counts in self._ports.counts().items())

    def _mission(self) -> MissionNow:
        for entered in self._entered.drain():
            self._last = entered
        last, task = self._last, self._tasks.current
        book = task.progress.book.targets if task is not None else ()
        return MissionNow(
            state=last.state if last is not None else State.IDLE,
            reason=last.reason if last is not None else "no mission yet",
            since_s=last.stamp_s if last is not None else 0.0,
            stop=task.progress.stop if task is not None else 0,
            stops=self._stops,
            targets=dict(Counter(str(target.state) for target in book)),
        )

    async def _sums(self) -> LedgerNow | None:
        """None without a task, and when the ledger does not answer in time."""
        task = self._tasks.current
        if task is None:
            return None
        try:
            async with asyncio.timeout(LEDGER_ANSWER_S):
                totals = await work(lambda: self._ledger.totals(task.id), LEDGER_WRITE_S)
        except (TimeoutError, SprayerError) as error:
            why = str(error) or "no answer in time"
            self._bus.publish(Trouble(f"the ledger's sums cannot be had: {why}", _now_s()))
            return None
        opened = sum(count for kind, count in totals.pulses.items() if kind is not Outcome.NOT_OPENED)
        return LedgerNow(task.id, opened, totals.booked_ml, totals.pending_ml)


def _now_s() -> float:
    return asyncio.get_running_loop().time()

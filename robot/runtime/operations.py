"""What the control API asks of the living robot, done: arm, start, pause, stop, acknowledge, and how it is."""

from __future__ import annotations

import asyncio
from collections import Counter
from collections.abc import Callable, Mapping

from drivers.errors import DeviceError
from robot import safety
from robot.actuation import LEDGER_WRITE_S, Actuation, PartStopped
from robot.clock import work
from robot.control import (
    Declined,
    FaultNow,
    LatenessCounts,
    LedgerNow,
    MissionNow,
    Plan,
    PortCounts,
    Status,
    TaskChoice,
)
from robot.control.confirming import changed
from robot.errors import SprayerError
from robot.events import Bus
from robot.ledger import Ledger
from robot.ledger.values import Outcome, Task
from robot.mission import Localiser, State, StateEntered
from robot.runtime.lateness import LoopLateness
from robot.runtime.rows import Rows
from robot.runtime.tasks import OpenTask, Tasks
from robot.runtime.upkeep import Upkeep
from robot.safety import MODE_CHANGES, Mode, Verb

LEDGER_ANSWER_S = 1.0


class Operations:
    """The runtime's side of ``robot.control.Machine``.

    ``place`` puts the rover where a task says it stands; ``check`` raises ``SprayerError`` for what this machine can
    never start a mission with; ``on_trouble`` is told of parts that do not do as told.
    """

    def __init__(
        self, name: str, today: Task, stops: int, upkeep: Upkeep, tasks: Tasks, rows: Rows, ledger: Ledger,
        localiser: Localiser, bus: Bus, lamp: bool, place: Callable[[OpenTask], None], check: Callable[[], None],
        on_trouble: Callable[[str], None], count_ports: Callable[[], Mapping[str, Mapping[str, int]]],
    ) -> None:  # fmt: skip
        self._name, self._today, self._stops, self._lamp = name, today, stops, lamp
        self._upkeep, self._tasks, self._rows = upkeep, tasks, rows
        self._ledger, self._localiser = ledger, localiser
        self._place, self._check, self._on_trouble, self._count_ports = place, check, on_trouble, count_ports
        self._entered = bus.subscribe(StateEntered, newest_only=True)
        self._last_entered: StateEntered | None = None
        self._mode, self._mode_since_s, self._mode_changes = Mode.DISARMED, 0.0, 0
        self.loop_lateness = LoopLateness()

    @property
    def _actuation(self) -> Actuation:
        return self._upkeep.actuation

    def mode_changed(self, state: safety.SafetyState) -> None:
        self._mode_changes += 1
        if state.mode is not self._mode:
            self._mode, self._mode_since_s = state.mode, asyncio.get_running_loop().time()
        self._rows.mode_changed(state)

    # --- how it is --------------------------------------------------------------------------------------------

    async def status(self) -> Status:
        state, supervisor = self._actuation.state, self._upkeep.supervisor
        return Status(
            robot=self._name,
            now_s=asyncio.get_running_loop().time(),
            mode=state.mode,
            mode_since_s=self._mode_since_s,
            causes=state.causes,
            faults=tuple(FaultNow(fault.id, fault.text, fault.since_s) for fault in state.faults),
            mission=self._mission_now(),
            ledger=await self._ledger_now(),
            tank_left_ml=self._actuation.tank_left_ml if self._tasks.current is not None else None,
            tasks=supervisor.health if supervisor is not None else (),
            unhealthy=supervisor.healthy() if supervisor is not None else "",
        )

    def lateness(self) -> LatenessCounts:
        return self.loop_lateness.counts

    def ports(self) -> tuple[PortCounts, ...]:
        return tuple(PortCounts(device, counts) for device, counts in self._count_ports().items())

    def _mission_now(self) -> MissionNow:
        for entered in self._entered.drain():
            self._last_entered = entered
        last, task = self._last_entered, self._tasks.current
        book = task.progress.book.targets if task is not None else ()
        return MissionNow(
            state=last.state if last is not None else State.IDLE,
            reason=last.reason if last is not None else "no mission yet",
            since_s=last.stamp_s if last is not None else 0.0,
            stop=task.progress.stop if task is not None else 0,
            stops=self._stops,
            targets=dict(Counter(str(target.state) for target in book)),
        )

    async def _ledger_now(self) -> LedgerNow | None:
        """None without a task, and when the ledger does not answer in time."""
        task = self._tasks.current
        if task is None:
            return None
        try:
            async with asyncio.timeout(LEDGER_ANSWER_S):
                totals = await work(lambda: self._ledger.totals(task.id), LEDGER_WRITE_S)
        except (TimeoutError, SprayerError) as error:
            self._on_trouble(f"the ledger's sums cannot be had: {error or 'no answer in time'}")
            return None
        opened = sum(count for kind, count in totals.pulses.items() if kind is not Outcome.NOT_OPENED)
        return LedgerNow(task.id, opened, totals.booked_ml, totals.pending_ml)

    # --- what it does -----------------------------------------------------------------------------------------

    async def stop(self, cause: str) -> tuple[PartStopped, ...]:
        return await self._actuation.stop(cause)

    async def arm(self, cause: str) -> None:
        """Contactor and torque on, then arm; off again when it is refused."""
        self._demand_possible(Verb.ARM)
        await self._wound_down()
        reasons: tuple[str, ...] = ()
        try:
            await self._actuation.energise(self._lamp)
        except DeviceError as error:
            reasons = (str(error),)
        reasons = reasons or self._actuation.change_mode(Verb.ARM, cause).reasons
        if reasons:
            await self._de_energise()
            raise Declined(*reasons, *self._actuation.state.causes)

    async def plan(self, choice: TaskChoice) -> Plan:
        self._demand_possible(Verb.START)
        try:
            self._check()
        except SprayerError as error:
            raise Declined(str(error)) from error
        number, stop, tank_ml, label_ml = await self._tasks.plan(choice)
        x_m = self._localiser.pose.x_m if number is not None and self._localiser.started else 0.0
        return Plan(
            number, self._today.route, stop, self._stops, self._today.product, self._today.water, self._today.operator,
            tank_ml, label_ml, x_m, self._actuation.state.mode, self._mode_changes,
        )  # fmt: skip

    async def start(self, plan: Plan, cause: str) -> int:
        await self._wound_down()
        now = await self.plan(TaskChoice.NEW if plan.task is None else TaskChoice.RESUME)
        if differences := changed(plan, now):
            raise Declined(*differences, "ask for a new plan")
        resume = plan.task is not None
        task = await work(lambda: self._tasks.open(resume), LEDGER_WRITE_S)
        self._tasks.adopt(task)
        return self._begin(task, cause)

    def _begin(self, task: OpenTask, cause: str) -> int:
        """Nothing is awaited in here: between safety's yes and the mission nothing can come."""
        assert self._upkeep.supervisor is not None
        try:
            self._place(task)
        except SprayerError as error:
            raise Declined(str(error)) from error
        self._demand(self._actuation.change_mode(Verb.START, cause))
        self._rows.begin(self._upkeep.supervisor, task)
        return task.id

    async def pause(self, cause: str) -> None:
        self._demand(await self._actuation.pause(cause))

    async def resume(self, cause: str) -> None:
        self._demand(self._actuation.change_mode(Verb.RESUME, cause))

    async def acknowledge(self, cause: str) -> None:
        await self._unlatch(Verb.ACKNOWLEDGE, cause)

    async def reset(self, cause: str) -> None:
        await self._unlatch(Verb.RESET, cause)

    async def disarm(self, cause: str) -> None:
        """Out of any mode but a latched one: what moves is halted, every output off, the arm holds."""
        self._demand(await self._actuation.disarm(cause))
        await self._de_energise()
        await self._wound_down()

    async def _unlatch(self, verb: Verb, cause: str) -> None:
        self._demand_possible(verb)
        await self._wound_down()
        self._demand(self._actuation.change_mode(verb, cause))
        await self._de_energise()

    async def _wound_down(self) -> None:
        if not await self._rows.wound_down():
            raise Declined("the mission is still winding down; look for a device that does not answer")

    async def _de_energise(self) -> None:
        for part in await self._actuation.de_energise():
            if part.error:
                self._on_trouble(f"{part.part}: {part.error}")

    def _demand_possible(self, verb: Verb) -> None:
        state = self._actuation.state
        if (state.mode, verb) not in MODE_CHANGES:
            raise Declined(f"{verb} is not possible in mode {state.mode}", *state.causes)

    def _demand(self, decision: safety.Decision) -> None:
        if not decision.allowed:
            raise Declined(*decision.reasons, *self._actuation.state.causes)


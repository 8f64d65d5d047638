"""What the control API asks of the living robot, done: arm, start, pause, stop, acknowledge."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from drivers.errors import DeviceError
from robot import safety
from robot.actuation import LEDGER_WRITE_S, Actuation, PartStopped
from robot.clock import work
from robot.control import Declined, LatenessCounts, Plan, PortCounts, Status, TaskChoice
from robot.control.confirming import changed
from robot.errors import SprayerError
from robot.ledger.values import Task
from robot.mission import Localiser
from robot.runtime.rows import Rows
from robot.runtime.state_report import StateReport
from robot.runtime.tasks import OpenTask, Tasks
from robot.runtime.upkeep import Upkeep
from robot.safety import MODE_CHANGES, Mode, Verb

_ACTING = (Mode.AUTO, Mode.MANUAL)


@dataclass(frozen=True, slots=True)
class Ways:
    """What only the whole life knows how to do.

    ``place`` puts the rover where a task says it stands; ``check`` raises ``SprayerError`` for what this machine can
    never start a mission with; ``tell`` is told of parts that do not do as told.
    """

    place: Callable[[OpenTask], None]
    check: Callable[[], None]
    tell: Callable[[str], None]


class Operations:
    """The runtime's side of ``robot.control.Machine``. ``tank_ml`` goes into the tank; ``lamp``: it is lit with the
    contactor."""

    def __init__(
        self, today: Task, tank_ml: float, stops: int, lamp: bool, upkeep: Upkeep, tasks: Tasks, rows: Rows,
        localiser: Localiser, report: StateReport, ways: Ways,
    ) -> None:  # fmt: skip
        self._today, self._tank_ml, self._stops, self._lamp = today, tank_ml, stops, lamp
        self._upkeep, self._tasks, self._rows, self._localiser = upkeep, tasks, rows, localiser
        self._report, self._ways = report, ways
        self._mode_changes = 0

    @property
    def _actuation(self) -> Actuation:
        return self._upkeep.actuation

    def mode_changed(self, state: safety.SafetyState) -> None:
        self._mode_changes += 1
        self._report.mode_changed(state)
        self._rows.mode_changed(state)

    async def status(self) -> Status:
        return await self._report.status()

    def lateness(self) -> LatenessCounts:
        return self._report.lateness.counts

    def ports(self) -> tuple[PortCounts, ...]:
        return self._report.ports()

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
            self._ways.check()
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
            self._ways.place(task)
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

    async def refill(self, tank_ml: float, cause: str) -> None:
        """The tank was filled: the balance goes on from ``tank_ml``."""
        if not 0.0 < tank_ml <= self._tank_ml:
            raise Declined(
                f"a refill to {tank_ml:g} ml: expected what the tank holds now, more than 0 and at most "
                f"{self._tank_ml:g} ml (fluid.tank_ml)"
            )
        number = await self._tasks.to_refill_for()
        if self._actuation.state.mode in _ACTING:
            raise Declined(f"the tank is not filled in mode {self._actuation.state.mode}; pause or stop first")
        if self._actuation.shot_under_way:
            raise Declined("a shot is not booked yet; ask again in a second")
        await self._tasks.refill(number, tank_ml, cause)

    async def disarm(self, cause: str) -> None:
        """Out of any mode but a latched one: what moves is halted, every output off, the arm holds."""
        self._demand(await self._actuation.disarm(cause))
        await self._de_energise()
        await self._wound_down()

    async def _unlatch(self, verb: Verb, cause: str) -> None:
        self._demand_possible(verb)
        await self._wound_down()
        former = self._actuation.state
        self._demand(self._actuation.change_mode(verb, cause))
        await self._de_energise()
        await self._upkeep.acknowledged(former)

    async def _wound_down(self) -> None:
        if not await self._rows.wound_down():
            raise Declined("the mission is still winding down; look for a device that does not answer")

    async def _de_energise(self) -> None:
        for part in await self._actuation.de_energise():
            if part.error:
                self._ways.tell(f"{part.part}: {part.error}")

    def _demand_possible(self, verb: Verb) -> None:
        state = self._actuation.state
        if (state.mode, verb) not in MODE_CHANGES:
            raise Declined(f"{verb} is not possible in mode {state.mode}", *state.causes)

    def _demand(self, decision: safety.Decision) -> None:
        if not decision.allowed:
            raise Declined(*decision.reasons, *self._actuation.state.causes)


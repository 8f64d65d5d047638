"""The mock rover with upkeep, ledger and every monitor, step by step in virtual time; killed and booted at will."""

from __future__ import annotations

import asyncio
import math
import shutil
from collections.abc import Awaitable, Callable, Coroutine
from contextlib import AsyncExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

from drivers.errors import DeviceError
from drivers.relay.values import Channel
from drivers.twin import commands as c
from drivers.twin.faults import Fault, FaultPlan
from robot import safety
from robot.actuation import Actuation, PulseOrder
from robot.clock import VirtualClockLoop
from robot.errors import SprayerError
from robot.ledger import Ledger
from robot.mission.spray import full_pulse_ml
from robot.runtime import ModeChanged, ledger_path
from robot.runtime.backends import BuildOptions, build_devices
from robot.runtime.resuming import given_before
from robot.runtime.settings import task
from robot.runtime.upkeep import Upkeep
from robot.soak.composition import rules_of
from robot.soak.life import WallClock
from robot.soak.machine_line import MachineLine
from robot.soak.machine_truth import MachineTruth
from robot.soak.monitors import ACTING, Account, Bench, Court, Leases, Liveness, Motion, Openings, Permission
from robot.soak.watch import Watch, WatchedBus
from tests.properties.rover_parts import DEMO, parts
from tests.robot.machine import a_target, gentle

T = TypeVar("T")
TARGETS = 4
PRESSURE_S = 1.5  # until the pump has it up


Hands = Callable[[Actuation], Actuation]


class SystemRig:
    """``boot`` first. ``alter`` may put something else in the hands' place: a seeded bug. Close it at the end."""

    def __init__(self, folder: Path, seed: int = 1, alter: Hands = lambda hands: hands) -> None:
        self.parts, self.folder, self._alter = parts(), folder, alter
        self.twin = self.parts.twin(seed)
        self.court = Court(MachineTruth(self.twin), rules_of(self.parts.config))
        court = self.court
        self.openings, self.permission, self.account = Openings(court), Permission(court), Account(court)
        self.bench = Bench(
            court, (self.openings, self.account, self.permission, Motion(court), Leases(court), Liveness(court))
        )
        self.watch, self.wall = Watch(self.bench), WallClock()
        self.loop: VirtualClockLoop
        self.wall.runs_by(lambda: self.watch.origin_s + self.loop.time())
        self.ledgers = 0
        self.hands: Actuation | None = None
        self.troubles: list[str] = []
        self._doing: list[asyncio.Task[Any]] = []
        self._life: asyncio.Task[None] | None = None
        self._task_id: int | None = None
        self._new_folder()
        self.court.ledger.begin(ledger_path(self._ledger_folder))

    def _new_folder(self) -> None:
        self.ledgers += 1
        self._ledger_folder = self.folder / f"ledger-{self.ledgers}"
        self._ledger_folder.mkdir()

    # --- life

    def boot(self) -> bool:
        """A process comes up, disarmed. False when it cannot, as with a device that does not answer."""
        assert self._life is None
        self.court.truth.before_another_plan()
        there_s, was_s = self.now_s, self.twin.physics.t_s
        self.twin.begin(self.watch, self._lasting_faults())
        self.watch.origin_s = self.court.t_s = there_s + (self.twin.physics.t_s - was_s)
        self.bench.begin()
        self.loop = VirtualClockLoop(threads=False)
        self.line = MachineLine(self.twin)
        self._up, self._leave = self.loop.create_future(), self.loop.create_future()
        self._life = self.loop.create_task(self._live())
        self.loop.run_until_complete(asyncio.wait((self._life, self._up), return_when=asyncio.FIRST_COMPLETED))
        if self._up.done():
            return True
        self._over()
        return False

    def _lasting_faults(self) -> FaultPlan:
        """What is wrong with the devices does not end with the process; in the clock of the next one."""
        next_s = math.ceil(self.twin.physics.t_s - 1e-9)
        return FaultPlan(
            Fault(fault.device, fault.verb, max(0.0, fault.start_s - next_s), fault.end_s - max(fault.start_s, next_s))
            for fault in self.twin.physics.plan.faults
            if fault.end_s > next_s
        )

    async def _live(self) -> None:
        line, loop = self.line, self.loop
        bus = WatchedBus(self.bench, self.watch.origin_s, lambda: not line.cut)

        def told(state: safety.SafetyState) -> None:
            bus.publish(ModeChanged(state.mode, state.causes, loop.time()))
            if state.mode not in ACTING:  # as the mission does with its state's task
                for task_ in self._doing:
                    task_.cancel()

        config = self.parts.config
        async with AsyncExitStack() as stack:
            self.ledger = stack.enter_context(Ledger.open(ledger_path(self._ledger_folder), self.wall.utc))
            devices = build_devices(
                config, self.parts.arm, line.as_twin(), loop.time, BuildOptions(DEMO), stack
            )  # fmt: skip
            await devices.open(stack, self.troubles.append)
            self.ledger.begin_run("boot", self.wall.utc())
            self.ledger.book_dangling(self.wall.utc())
            upkeep = Upkeep(config, devices, self.ledger, told, self.troubles.append)
            hands = self._alter(upkeep.actuation)
            upkeep.actuation = hands
            self._begin_task(hands)
            async with upkeep.living(lambda _odometry: None) as self.group:
                self.hands, self.devices = hands, devices
                self._up.set_result(None)
                await self._leave

    def _begin_task(self, hands: Actuation) -> None:
        fill_ml = self.parts.config.task.tank_fill_ml
        if self._task_id is None:
            self._task_id = self.ledger.begin_task(task(self.parts.config, self.parts.row))
            targets = [replace(a_target(number), id=number) for number in range(1, TARGETS + 1)]
            self.ledger.upsert_targets(self._task_id, targets)
        given = given_before(self.ledger, self._task_id, self.wall.utc(), self.loop.time())
        hands.begin_task(self._task_id, fill_ml - given.task_ml, given)

    def shut_down(self) -> None:
        """The process ends as SIGTERM makes it: clean."""
        if self._life is None:
            return
        if not self._leave.done():
            self._leave.set_result(None)
        self._over()

    def kill(self) -> None:
        """The process is gone at this moment, whatever it was doing; the machine runs on by its own timers."""
        if self._life is None:
            return
        self.twin.advance(self.loop.time())
        self.line.cut = True
        lasted_s = self.loop.time()
        before = ledger_path(self._ledger_folder)
        self._new_folder()
        for file in (before, before.with_name(f"{before.name}-wal")):
            if file.exists():
                shutil.copyfile(file, self._ledger_folder / file.name)
        self.bench.killed(self.watch.origin_s + lasted_s)
        self._life.cancel()
        self._unwind()
        self.court.ledger.follow(ledger_path(self._ledger_folder))
        for _ in range(60):
            if not self.twin.physics.resting:
                self.twin.advance(self.twin.now_s + 0.5)
        self._ended()

    def _over(self) -> None:
        self._unwind()
        self._ended()

    def _unwind(self) -> None:
        assert self._life is not None
        (end,) = self.loop.run_until_complete(asyncio.gather(self._life, return_exceptions=True))
        if not self.line.cut:
            self.twin.advance(self.loop.time())
            if isinstance(end, BaseException):
                self._expected(end)
        for other in asyncio.all_tasks(self.loop):
            other.cancel()
            self.loop.run_until_complete(asyncio.gather(other, return_exceptions=True))
        self.loop.close()
        self._doing.clear()
        self._life = self.hands = None

    def _ended(self) -> None:
        self.court.t_s = max(self.court.t_s, self.now_s)
        self.bench.end()

    def _expected(self, end: BaseException) -> None:
        if isinstance(end, BaseExceptionGroup):
            for inner in end.exceptions:
                self._expected(inner)
        elif not isinstance(end, SprayerError | DeviceError | asyncio.CancelledError):
            raise end

    def close(self) -> None:
        """The last process ends clean."""
        self.shut_down()
        self.court.ledger.close()

    # --- what is done to it

    @property
    def now_s(self) -> float:
        """In the clock of the whole story."""
        return self.watch.origin_s + self.twin.now_s

    @property
    def alive(self) -> bool:
        return self._life is not None and not self._life.done()

    def wait(self, seconds: float) -> None:
        """Time goes by, for the process if there is one."""
        if self._life is None:
            self.twin.advance(self.twin.now_s + seconds)
            return
        self.do(asyncio.sleep(seconds))
        if self._life.done():
            self._over()
        else:
            self.twin.advance(self.loop.time())

    def do(self, action: Coroutine[Any, Any, T] | Awaitable[T]) -> T | None:
        """Do this and wait for it; what is refused or fails in a way that people are told of counts as done."""

        return self.loop.run_until_complete(_told(action))

    def begin(self, action: Coroutine[Any, Any, Any]) -> None:
        """Begin this, and go on with other things meanwhile."""
        self._doing = [task_ for task_ in self._doing if not task_.done()]

        async def as_its_own() -> None:
            self._doing.append(self.group.create_task(_told(action)))

        self.do(as_its_own())

    def cancel_all(self) -> None:
        """Whoever waits for something no longer does; a valve that was opened for them must shut."""
        if any(not task_.done() for task_ in self._doing):
            self.court.t_s = max(self.court.t_s, self.now_s)
            self.openings.must_shut()
        for task_ in self._doing:
            task_.cancel()

    def suffer(self, command: c.Command) -> None:
        """Something is done to the machine."""
        self.twin.apply(self.loop.time() if self._life is not None else self.twin.now_s, command)

    def fails(self, device: str, verb: str, for_s: float) -> None:
        """From now on, for so long."""
        now_s = self.twin.physics.t_s
        known = [fault for fault in self.twin.physics.plan.faults if fault.end_s > now_s - 1000.0]
        self.twin.physics.plan = FaultPlan((*known, Fault(device, verb, now_s, for_s)))
        self.twin.physics.apply_faults()

    # --- what its operator does

    def verb(self, verb: safety.Verb) -> bool:
        """Say a verb of modes; stops do more than that. Whether it was obeyed."""
        hands = self.hands
        assert hands is not None
        if verb is safety.Verb.STOP:
            self.do(hands.stop("the operator's stop"))
            return True
        if verb is safety.Verb.ESTOP:
            self.do(hands.emergency_stop("the operator's emergency stop"))
            return True
        self.court.resume_asked = verb is safety.Verb.RESUME

        async def said() -> bool:
            return hands.change_mode(verb, "the operator").allowed

        return bool(self.do(said()))

    def make_ready(self) -> None:
        """Powered, armed, started, the frame taken, the pump up, the arm settled where it is."""
        self.do(self._make_ready())

    async def _make_ready(self) -> None:
        hands = self.hands
        assert hands is not None
        await hands.energise(lamp=False)
        for verb in (safety.Verb.ARM, safety.Verb.START):
            hands.change_mode(verb, "the operator")
        hands.mark_frame()
        await self.devices.camera.capture()
        await hands.start_pump()
        await self.settle_arm()
        await asyncio.sleep(PRESSURE_S)

    async def settle_arm(self, by_rad: float = 0.0) -> None:
        hands = self.hands
        assert hands is not None
        assert hands.joints_rad is not None
        here = hands.joints_rad
        await hands.move_arm(gentle(here, (here[0] + by_rad, *here[1:]), 0.2 if by_rad == 0.0 else 0.6))

    def order(self, target: int, open_s: float) -> PulseOrder:
        hands = self.hands
        assert hands is not None
        bar = max(hands.sensors.pressure_bar if hands.sensors else 0.0, 0.1)
        pulse_s = hands.board_pulse_s(open_s)
        model_ml = self.parts.dose.flow.volume_ml(open_s, bar)
        full_ml = full_pulse_ml(self.parts.dose, pulse_s, bar)
        return PulseOrder(target, 1, 1, model_ml, model_ml, model_ml, open_s, pulse_s, full_ml)

    @property
    def valve_on(self) -> bool:
        return self.court.truth.coil(Channel.VALVE)

    @property
    def story(self) -> str:
        """Every property seen broken, and how it came to that."""
        return "\n".join(
            "\n".join((f"{item.property} at {item.t_s:.3f} s: {item.text}", *item.before[-30:]))
            for item in self.court.violations.values()
        )


async def _told(action: Awaitable[T]) -> T | None:
    try:
        return await action
    except (SprayerError, DeviceError):
        return None

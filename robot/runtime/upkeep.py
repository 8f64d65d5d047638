"""Keeps a machine's readings fresh while it is up, stops it when a device fails, and lets go of it at the end."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable, Sequence
from contextlib import asynccontextmanager
from dataclasses import dataclass

from drivers.wheels.values import Odometry
from robot import safety
from robot.actuation import Actuation
from robot.config import Config
from robot.errors import UnavailableError
from robot.ledger import Ledger
from robot.runtime.devices import Devices
from robot.runtime.mode_log import MODE_EVENT, ModeLog
from robot.runtime.settings import hand_settings, limits
from robot.runtime.stall_watch import CAUSE, StallWatch, stop_lanes
from robot.safety.failsafe import fault_of
from robot.supervision import Health, Supervisor, TaskHealth

FIRST_READINGS_S = 3.0
STALLED = "F30"
NOZZLE = "F66"  # "check the nozzle": over once an operator says so
WATCH_SILENCE_S = 3.0  # a loop without a beat is the watch's business; this is about the watch
_MUST_STOP = (safety.Mode.AUTO, safety.Mode.MANUAL, safety.Mode.PAUSED, safety.Mode.SAFE_STOP, safety.Mode.ESTOP)


@dataclass(frozen=True, slots=True)
class Poll:
    """A task beside those that safety needs; see ``Supervisor.poll``."""

    name: str
    owner: str
    step: Callable[[], Awaitable[None]]
    period_s: float
    longest_silence_s: float


class Upkeep:
    """Owns actuation, its polls and the log of modes. ``on_mode`` and ``on_trouble`` are told what happens."""

    def __init__(
        self, config: Config, devices: Devices, ledger: Ledger, on_mode: Callable[[safety.SafetyState], None],
        on_trouble: Callable[[str], None],
    ) -> None:  # fmt: skip
        self._on_mode, self._on_trouble, self._ledger = on_mode, on_trouble, ledger
        self._operator = config.task.operator
        self._lanes = None if config.simulated else stop_lanes(devices)  # virtual time does not stall
        self._modes = ModeLog(ledger)
        self._told = safety.SafetyState()
        self._failed_tasks: set[str] = set()  # faults that a failing task is
        self._resumes_itself = config.safety.self_resume
        self.actuation = Actuation(
            devices.arm, devices.relay, devices.wheels, devices.inputs, ledger, limits(config), hand_settings(config),
            self._mode_changed,
        )  # fmt: skip
        self.supervisor: Supervisor | None = None  # while ``living`` lasts, and what was of it afterwards

    @asynccontextmanager
    async def living(
        self, on_odometry: Callable[[Odometry], None], polls: Sequence[Poll] = (), attended: bool = False
    ) -> AsyncIterator[asyncio.TaskGroup]:
        """Poll and supervise as long as the block lasts; then valve shut, base halted, arm held, outputs off.

        It comes up in the latch that the last life of the ledger ended in, unless a person's command ``attended`` began
        it: that command acknowledges the latch.
        ``UnavailableError`` when a device does not report. Errors leave in an ``ExceptionGroup``.
        """
        try:
            async with asyncio.TaskGroup() as group, self._watched(group) as watch:
                supervisor = Supervisor(group, lambda name, text: self._on_fault(group, name, text))
                self.supervisor = supervisor
                supervisor.keep("mode log", "ledger", self._modes.run)
                try:
                    await self._take_up(attended)
                    self._supervise(supervisor, on_odometry, polls)
                    if watch is not None:
                        supervisor.poll("stall watch", "runtime", watch.beat, watch.beat_s, WATCH_SILENCE_S)
                    await self._first_readings()
                    yield group
                finally:
                    await self._let_go()
                    supervisor.stop()
        finally:
            self._modes.write_rest()

    async def arm(self, verb: safety.Verb, cause: str, lamp: bool = False) -> None:
        """Contactor and torque on, then arm, then ``verb``. ``UnavailableError`` with the reasons against it."""
        await self.actuation.energise(lamp)
        for step in (safety.Verb.ARM, verb):
            decision = self.actuation.change_mode(step, cause)
            if not decision.allowed:
                reasons = (*decision.reasons, *self.actuation.state.causes)
                raise UnavailableError(f"cannot {step}: {'; '.join(reasons)}")

    async def acknowledged(self, former: safety.SafetyState) -> None:
        """What else an operator's acknowledgement of this state means: whoever was told to check the nozzle did so."""
        if safety.concerns(former, NOZZLE):
            await self.actuation.nozzle_checked(self._operator)

    async def _take_up(self, attended: bool) -> None:
        last = self._ledger.last_event(MODE_EVENT)  # nothing is polled yet that this could hold up
        former = safety.taken_up(last.text if last is not None else "")
        if former.mode not in safety.LATCHED:
            return
        if not attended:
            self.actuation.take_up(former)
            return
        text = f"this command acknowledges the {former.mode} {'; '.join(former.causes)}"
        self._on_trouble(text)
        self._modes.put(f"{safety.Mode.DISARMED} {text}", asyncio.get_running_loop().time())
        await self.acknowledged(former)

    def _supervise(
        self, supervisor: Supervisor, on_odometry: Callable[[Odometry], None], polls: Sequence[Poll]
    ) -> None:
        async def poll_odometry() -> None:
            await self.actuation.poll_odometry()
            if self.actuation.odometry is not None:
                on_odometry(self.actuation.odometry)

        supervisor.poll("sensors", "actuation", self.actuation.poll_sensors, 0.1, 0.5)
        supervisor.poll("odometry", "actuation", poll_odometry, 0.05, 0.3)
        supervisor.poll("arm", "actuation", self.actuation.poll_arm, 0.1, 0.5)
        supervisor.poll("relay", "actuation", self.actuation.poll_relay, 0.2, 5.0)
        supervisor.poll("faults", "actuation", lambda: self._look_after(supervisor), 0.2, 1.0)
        for poll in polls:
            supervisor.poll(poll.name, poll.owner, poll.step, poll.period_s, poll.longest_silence_s)
        supervisor.watch()

    async def _look_after(self, supervisor: Supervisor) -> None:
        """Clear the faults of tasks that are well again, and end a pause that may end by itself."""
        for fault_id in sorted(self._failed_tasks):
            if all(health.state is Health.READY for health in _tasks_of(fault_id, supervisor.health)):
                self._failed_tasks.discard(fault_id)
                self.actuation.clear(fault_id)
        if self._resumes_itself and self.actuation.state.mode is safety.Mode.PAUSED:
            self.actuation.change_mode(safety.Verb.RESUME_SELF, "the cause of the pause is gone")

    async def _first_readings(self) -> None:
        try:
            async with asyncio.timeout(FIRST_READINGS_S):
                while True:
                    if self.actuation.all_reported:
                        break
                    await asyncio.sleep(0.02)
        except TimeoutError:
            raise UnavailableError(
                f"not every device reported within {FIRST_READINGS_S} s; look at the faults above and mend the device"
            ) from None
        await self.actuation.begin_metering()

    async def _let_go(self) -> None:
        """A stop that is under way is made again, so that it is over before the devices are closed."""
        state = self.actuation.state
        if state.mode in _MUST_STOP:
            for part in await self.actuation.stop(state.causes[-1] if state.causes else "the program is going down"):
                self._tell_failed(part.part, part.error)
        for part in await self.actuation.de_energise():
            self._tell_failed(part.part, part.error)

    def _tell_failed(self, part: str, error: str) -> None:
        if error:
            self._on_trouble(f"{part}: {error}")

    def _mode_changed(self, state: safety.SafetyState) -> None:
        if (state.mode, state.causes) == (self._told.mode, self._told.causes):
            return
        self._told = state
        self._modes.put(safety.mode_line(state), asyncio.get_running_loop().time())
        self._on_mode(state)

    @asynccontextmanager
    async def _watched(self, group: asyncio.TaskGroup) -> AsyncIterator[StallWatch | None]:
        """A loop in real time is watched from a thread; a stall is the fault F30."""
        if self._lanes is None:
            yield None
            return

        def on_stall(for_s: float) -> None:
            cause = f"{CAUSE} for {for_s:.1f} s"
            self._on_trouble(f"{STALLED}: {cause}; everything was switched off meanwhile, the log tells where it stood")
            group.create_task(report(cause), name="fault of a stall")

        async def report(cause: str) -> None:
            await self.actuation.report(STALLED, cause)
            if self.actuation.state.mode is safety.Mode.DISARMED:  # nothing was at stake
                self.actuation.clear(STALLED)
            await watch.release()

        with StallWatch(self._lanes, on_stall) as watch:
            yield watch

    def _on_fault(self, group: asyncio.TaskGroup, name: str, text: str) -> None:
        what = text if text.startswith(f"{name}: ") else f"{name}: {text}"
        self._on_trouble(what)
        self._failed_tasks.add(fault_of(name))
        group.create_task(self.actuation.report(fault_of(name), what), name=f"fault of {name}")


def _tasks_of(fault_id: str, tasks: Sequence[TaskHealth]) -> list[TaskHealth]:
    return [task for task in tasks if fault_of(task.name) == fault_id]

"""The only hands: every command that moves or sprays goes through here, asks safety first, and is accounted for."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable

from drivers.arm.interface import Arm
from drivers.arm.values import JointTrajectory
from drivers.errors import DeviceError
from drivers.inputs.interface import Inputs as InputDevices
from drivers.inputs.values import InputState
from drivers.relay.interface import RelayBoard
from drivers.relay.values import Channel
from drivers.wheels.interface import Wheels
from drivers.wheels.values import Odometry
from robot import safety
from robot.actuation.gate import Gate, now_s
from robot.actuation.liquid import Liquid
from robot.actuation.readings import Readings
from robot.actuation.stopping import stop_part
from robot.actuation.values import HandSettings, PartStopped, PulseOrder
from robot.ledger import Ledger
from robot.ledger.values import Result
from robot.safety.timing import BASE_STILL_M_S, FRAME_MOTION_MAX_M


class Actuation:
    """Holds the handles that can move or spray, the safety state, and the flow account of one run."""

    def __init__(
        self,
        arm: Arm,
        relay: RelayBoard,
        wheels: Wheels,
        inputs: InputDevices,
        ledger: Ledger,
        limits: safety.Limits,
        settings: HandSettings,
        on_mode: Callable[[safety.SafetyState], None],
    ) -> None:
        self._arm, self._relay, self._wheels, self._inputs = arm, relay, wheels, inputs
        self._settings = settings
        self._readings = Readings(settings)
        self._gate = Gate(self._readings, limits, on_mode)
        self._liquid = Liquid(relay, inputs, ledger, self._gate, self._readings, settings, self.stop, self.report)

    # --- what is known of the machine -------------------------------------------------------------------------

    @property
    def state(self) -> safety.SafetyState:
        return self._gate.state

    @property
    def odometry(self) -> Odometry | None:
        return self._readings.odometry

    @property
    def sensors(self) -> InputState | None:
        return self._readings.sensors

    @property
    def joints_rad(self) -> tuple[float, ...] | None:
        return self._readings.joints_rad

    @property
    def arm_stowed(self) -> bool:
        return self._readings.arm_stowed

    @property
    def tank_left_ml(self) -> float:
        return self._readings.tank_left_ml

    @property
    def base_moved(self) -> bool:
        """Whether the base rolled so far since the frame that a new one is needed."""
        return self._readings.moved_since_frame_m > FRAME_MOTION_MAX_M

    @property
    def base_disturbed(self) -> bool:
        """Whether the base rolls now, or moved since the frame."""
        reading = self._readings.odometry
        rolls = reading is None or max(abs(reading.left_m_s), abs(reading.right_m_s)) > BASE_STILL_M_S
        return rolls or self.base_moved

    @property
    def lamp_lit(self) -> bool:
        """By the relay board's last reading."""
        reading = self._readings.relay
        return reading is not None and reading.coils.get(Channel.LAMP, False)

    @property
    def all_reported(self) -> bool:
        return self._readings.inputs() is not None

    @property
    def shot_under_way(self) -> bool:
        """From the authorisation of a shot until it is booked."""
        return self._liquid.shot_under_way

    def mark_frame(self) -> None:
        """The base stands where it stood when the newest frame was taken: motion is counted from here."""
        self._readings.frame_mark = self._readings.odometry

    def begin_task(self, task_id: int, tank_left_ml: float, given: safety.Given) -> None:
        """Which task the ledger books on, and what earlier runs gave that counts for its caps."""
        self._liquid.begin_task(task_id)
        self._readings.tank_left_ml = tank_left_ml
        self._gate.begin_task(given)

    def refilled(self, tank_left_ml: float) -> None:
        """Somebody filled the tank: the balance of the ledger goes on from here."""
        self._readings.tank_left_ml = tank_left_ml

    def note_fence(self, margin_m: float) -> None:
        """How far inside of the geofence the base is, less the uncertainty of its pose."""
        self._readings.fence_margin_m = margin_m

    async def nozzle_checked(self, operator: str) -> None:
        """An operator has seen to the nozzle after "check nozzle": spraying may go on."""
        await self._liquid.nozzle_checked(operator)

    async def begin_metering(self) -> None:
        """Start the flow account at the meter's present count."""
        await self._liquid.begin_metering()

    async def poll_sensors(self) -> None:
        self._readings.take_sensors(await self._inputs.read())
        await self._watch()
        await self._liquid.look_for_leak()

    async def poll_odometry(self) -> None:
        self._readings.odometry = await self._wheels.odometry()
        if self.base_moved:
            self._liquid.interrupt("the base moved")
        await self._watch()

    async def poll_arm(self) -> None:
        self._readings.take_arm(await self._arm.state())
        if not self._readings.arm_settled:
            self._liquid.interrupt("the arm moved")
        await self._watch()

    async def poll_relay(self) -> None:
        """Read the coils back and renew the pump's lease; leaves the bus alone while a shot is under way."""
        if not self._liquid.shot_under_way:
            self._readings.relay = await self._relay.read()
            await self._liquid.renew_pump()

    # --- faults and modes -------------------------------------------------------------------------------------

    async def report(self, fault_id: str, text: str) -> None:
        """A fault of the catalogue: its action is taken at once, and over when this returns."""
        before = self.state
        self._gate.report(fault_id, text)
        await self._act_on(before)

    def clear(self, fault_id: str) -> None:
        """The cause of a fault is gone."""
        self._gate.clear(fault_id)

    async def _watch(self) -> None:
        before = self.state
        self._gate.watch()
        await self._act_on(before)

    async def _act_on(self, before: safety.SafetyState) -> None:
        """Let go when a fault ended the mode or forbids motion, shut the valve when it forbids spray only."""
        after = self.state
        known = {fault.id for fault in before.faults}
        fresh = [fault for fault in after.faults if fault.id not in known]
        worst = safety.most_severe(fault.id for fault in fresh)
        energised = before.mode is not safety.Mode.DISARMED or after.mode is not before.mode
        if energised and (worst >= safety.Action.PAUSE or after.mode is not before.mode):
            await self._let_go()
        elif worst is safety.Action.INHIBIT_SPRAY:
            self._liquid.interrupt("; ".join(fault.text for fault in fresh))

    def take_up(self, former: safety.SafetyState) -> None:
        """Come up in the latch that an earlier run ended in; nothing moves yet."""
        self._gate.take_up(former)

    def change_mode(self, verb: safety.Verb, cause: str) -> safety.Decision:
        """Arm, start, operate, resume, finish, acknowledge, reset. What ends motion is ``stop``, ``emergency_stop``,
        ``pause`` and ``disarm``."""
        return self._gate.change_mode(verb, cause)

    async def stop(self, cause: str) -> tuple[PartStopped, ...]:
        """The operator's STOP: latch, close, halt, hold. Goes on past errors and reports each part."""
        self.change_mode(safety.Verb.STOP, cause)
        return await self._let_go()

    async def pause(self, cause: str) -> safety.Decision:
        """Valve shut, pump off, base halted, arm held, until somebody resumes."""
        return await self._end_motion(safety.Verb.PAUSE, cause)

    async def disarm(self, cause: str) -> safety.Decision:
        return await self._end_motion(safety.Verb.DISARM, cause)

    async def _end_motion(self, verb: safety.Verb, cause: str) -> safety.Decision:
        decision = self.change_mode(verb, cause)
        if decision.allowed:
            await self._let_go()
        return decision

    async def emergency_stop(self, cause: str) -> tuple[PartStopped, ...]:
        self.change_mode(safety.Verb.ESTOP, cause)
        return await self._let_go()

    async def _let_go(self) -> tuple[PartStopped, ...]:
        self._liquid.cut()
        self._readings.base_commanded = False
        self._readings.arm_settled = False
        parts: tuple[tuple[str, Callable[[], Awaitable[None]]], ...] = (
            ("valve", lambda: self._relay.cancel(Channel.VALVE)),
            ("base", self._wheels.stop),
            ("arm", self._arm.hold),
            ("pump", lambda: self._relay.cancel(Channel.PUMP)),
        )
        stopped = asyncio.gather(*(stop_part(name, action) for name, action in parts))
        return tuple(await asyncio.shield(stopped))

    async def energise(self, lamp: bool) -> None:
        """Before arming: main contactor and beacon on, and the lamp when it is wanted."""
        wanted = {Channel.CONTACTOR, Channel.BEACON} | ({Channel.LAMP} if lamp else set())
        for channel in sorted(wanted & self._relay.channels):
            await self._relay.switch(channel, True)
        await self._arm.torque(True)
        await self.poll_arm()
        await self.poll_relay()

    async def switch_lamp(self, on: bool) -> None:
        """Light the lamp, or put it out, and read it back; ``Refused`` when it is to be lit and nothing is armed."""
        if on:
            self._gate.demand_armed()
        await self._relay.switch(Channel.LAMP, on)
        await self.poll_relay()

    async def de_energise(self) -> tuple[PartStopped, ...]:
        """Everything off at the relay board, the arm goes on holding; then what still waits for the ledger."""
        self._liquid.cut()
        board = await stop_part("relay board", self._relay.all_off)
        return board, PartStopped("ledger", await self._liquid.finish())

    # --- who may move it by hand ------------------------------------------------------------------------------

    async def take_lease(self, holder: str, take_over: bool = False) -> safety.Decision:
        """The controls for mode MANUAL, alive for as long as ``beat_lease`` comes; all motion ends at a handover."""
        before = self.state.lease
        decision = self._gate.take_lease(holder, take_over)
        if decision.allowed and before is not None and before.holder != holder:
            await self._let_go()
        return decision

    def beat_lease(self, holder: str) -> safety.Decision:
        return self._gate.beat_lease(holder)

    def release_lease(self, holder: str) -> None:
        self._gate.release_lease(holder)

    # --- base and arm -----------------------------------------------------------------------------------------

    async def drive(self, speed_m_s: float, yaw_rate_rad_s: float) -> None:
        """One velocity command, good for the drive's command time-out; ``Refused`` with the reasons."""
        request = safety.MotionRequest("base", speed_m_s, yaw_rate_rad_s)
        self._gate.demand_motion(request)
        self._readings.base_commanded = speed_m_s != 0.0 or yaw_rate_rad_s != 0.0
        await self._wheels.drive(speed_m_s, yaw_rate_rad_s)

    async def halt_base(self) -> None:
        self._readings.base_commanded = False
        await self._wheels.stop()

    async def move_arm(self, trajectory: JointTrajectory) -> None:
        """Follow to the end and wait until every joint has settled.

        ``Refused`` by safety, ``DeviceError`` from the arm or when it does not settle. Cancelled, the arm holds.
        """
        self._gate.demand_motion(safety.MotionRequest("arm"))
        self._readings.arm_settled = False
        self._readings.goal_rad = trajectory.goal_rad
        await self._arm.follow(trajectory)
        await self._settle()

    async def _settle(self) -> None:
        tolerance_rad = self._settings.settle_tolerance_rad
        deadline_s = now_s() + self._settings.settle_timeout_s
        within_since_s: float | None = None
        while True:
            state = await self._arm.state()
            self._readings.take_arm(state)
            if self._readings.off_goal_rad > tolerance_rad:
                within_since_s = None
            elif within_since_s is None:
                within_since_s = state.stamp_s
            elif state.stamp_s - within_since_s >= self._settings.settle_s:
                self._readings.arm_settled = True
                return
            if now_s() > deadline_s:
                raise DeviceError(
                    "arm",
                    f"every joint within {tolerance_rad} rad of its goal",
                    f"{self._readings.off_goal_rad:.3f} rad after {self._settings.settle_timeout_s} s",
                    "look for something that blocks the arm",
                )
            await asyncio.sleep(0.02)

    # --- liquid -----------------------------------------------------------------------------------------------

    async def start_pump(self) -> None:
        """Ask for pressure; the pump runs on leases that ``poll_relay`` renews."""
        await self._liquid.start_pump()

    async def stop_pump(self) -> None:
        await self._liquid.stop_pump()

    def board_pulse_s(self, open_s: float) -> float:
        """The board's own timer for an opening: the next multiple of its quantum."""
        return self._liquid.board_pulse_s(open_s)

    async def spray(self, order: PulseOrder) -> Result:
        """Open the valve once and account for it; see ``Liquid.spray``."""
        return await self._liquid.spray(order)

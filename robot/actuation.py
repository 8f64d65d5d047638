"""The only hands: every command that moves or sprays goes through here, asks safety first, and is accounted for."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Awaitable, Callable
from dataclasses import dataclass

from drivers.arm.interface import Arm
from drivers.arm.values import ArmState, JointTrajectory
from drivers.errors import DeviceError
from drivers.inputs.interface import Inputs as InputDevices
from drivers.inputs.values import InputState
from drivers.relay.interface import RelayBoard
from drivers.relay.values import Channel, RelayState
from drivers.wheels.interface import Wheels
from drivers.wheels.values import Odometry
from robot import safety
from robot.clock import work
from robot.errors import SprayerError
from robot.ledger import Ledger
from robot.ledger.values import Intent, Outcome, Result
from robot.safety.timing import CLOSE_DEADLINE_S, CLOSE_TRIES, FRAME_MOTION_MAX_M

LEDGER_WRITE_S = 0.002  # modelled duration of one durable transaction in virtual time
METER_SETTLE_S = 0.15   # after the valve is shut, until the flow meter has counted its last pulse
STOWED_TOLERANCE_RAD = 0.04


class Refused(SprayerError):
    """Safety did not allow a command; the message holds its reasons."""


@dataclass(frozen=True, slots=True)
class HandSettings:
    """What the hands need to know of the machine."""

    stow_rad: tuple[float, ...]
    settle_tolerance_rad: float
    settle_s: float
    settle_timeout_s: float
    pump_lease_s: float
    meter_ml_per_pulse: float
    meter_tolerance: float
    valve_close_s: float


@dataclass(frozen=True, slots=True)
class PulseOrder:
    """One valve opening of a shot. ``model_ml`` is what the flow model expects of ``open_s``; ``full_ml`` the most that
    the board's whole pulse of ``pulse_s`` can give."""

    target_id: int
    stop: int
    number: int
    due_ml: float
    dose_ml: float
    model_ml: float
    open_s: float
    pulse_s: float
    full_ml: float


@dataclass(frozen=True, slots=True)
class PartStopped:
    """One line of the report of a stop; ``error`` is "" when the part did as told."""

    part: str
    error: str


@dataclass
class _Readings:
    sensors: InputState | None = None
    odometry: Odometry | None = None
    arm: ArmState | None = None
    relay: RelayState | None = None


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
        self._ledger = ledger
        self._limits = limits
        self._settings = settings
        self._on_mode = on_mode
        self._state = safety.SafetyState()
        self._readings = _Readings()
        self._task_id: int | None = None
        self._tank_left_ml = 0.0
        self._goal_rad: tuple[float, ...] | None = None
        self._arm_settled = False
        self._base_commanded = False
        self._frame_mark: Odometry | None = None
        self._pump_wanted = False
        self._pump_until_s = 0.0
        self._shot_under_way = False
        self._cut = asyncio.Event()
        self._accounted_to_ml: float | None = None

    # --- what is known of the machine -------------------------------------------------------------------------

    @property
    def state(self) -> safety.SafetyState:
        return self._state

    @property
    def odometry(self) -> Odometry | None:
        return self._readings.odometry

    @property
    def sensors(self) -> InputState | None:
        return self._readings.sensors

    @property
    def joints_rad(self) -> tuple[float, ...] | None:
        return self._readings.arm.position_rad if self._readings.arm else None

    @property
    def tank_left_ml(self) -> float:
        return self._tank_left_ml

    def board_pulse_s(self, open_s: float) -> float:
        """The board's own timer for an opening: the next multiple of its quantum."""
        quantum_s = self._relay.capability.pulse_quantum_s
        return quantum_s * math.ceil(open_s / quantum_s - 1e-9)

    def begin_task(self, task_id: int, tank_left_ml: float, task_ml: float, target_ml: dict[int, float]) -> None:
        """Which task the ledger books on, and what earlier runs of it gave."""
        self._task_id = task_id
        self._tank_left_ml = tank_left_ml
        self._state = safety.SafetyState(
            self._state.mode, self._state.causes, (), task_ml, tuple(sorted(target_ml.items()))
        )

    async def poll_sensors(self) -> None:
        reading = await self._inputs.read()
        self._readings.sensors = reading
        if reading.estop_pressed and self._state.mode is not safety.Mode.ESTOP:
            await self.emergency_stop("the e-stop was pressed")
        if reading.bumper_pressed and self._state.mode in (safety.Mode.AUTO, safety.Mode.MANUAL):
            await self.stop("the bumper was pressed")

    async def poll_odometry(self) -> None:
        self._readings.odometry = await self._wheels.odometry()

    async def poll_arm(self) -> None:
        state = await self._arm.state()
        self._readings.arm = state
        if self._goal_rad is not None and not self._within_tolerance(state):
            self._arm_settled = False

    async def poll_relay(self) -> None:
        """Read the coils back and renew the pump's lease; leaves the bus alone while a shot is under way."""
        if self._shot_under_way:
            return
        self._readings.relay = await self._relay.read()
        if self._pump_wanted:
            await self._renew_pump(self._settings.pump_lease_s / 2)

    def inputs(self) -> safety.Inputs | None:
        """The newest readings as safety wants them; None until every device has reported."""
        known = self._readings
        if not (known.sensors and known.odometry and known.arm and known.relay):
            return None
        return safety.Inputs(
            sensors_s=known.sensors.stamp_s,
            estop_pressed=known.sensors.estop_pressed,
            bumper_pressed=known.sensors.bumper_pressed,
            tilt_rad=max(abs(known.sensors.roll_rad), abs(known.sensors.pitch_rad)),
            pressure_bar=known.sensors.pressure_bar,
            odometry_s=known.odometry.stamp_s,
            base_speed_m_s=max(abs(known.odometry.left_m_s), abs(known.odometry.right_m_s)),
            moved_since_frame_m=self._moved_since_frame_m(known.odometry),
            base_commanded=self._base_commanded,
            arm_s=known.arm.stamp_s,
            arm_settled=self._arm_settled,
            arm_stowed=self.arm_stowed,
            arm_healthy=known.arm.torque_on and not any(known.arm.hardware_error),
            relay_s=known.relay.stamp_s,
            valve_coil=known.relay.coils.get(Channel.VALVE, True),
            tank_left_ml=self._tank_left_ml,
        )

    @property
    def arm_stowed(self) -> bool:
        joints = self.joints_rad
        return joints is not None and all(
            abs(a - b) <= STOWED_TOLERANCE_RAD for a, b in zip(joints, self._settings.stow_rad, strict=True)
        )

    def mark_frame(self) -> None:
        """The base stands where it stood when the newest frame was taken: motion is counted from here."""
        self._frame_mark = self._readings.odometry

    @property
    def base_moved(self) -> bool:
        """Whether the base rolled so far since the frame that a new one is needed."""
        now = self._readings.odometry
        return now is None or self._moved_since_frame_m(now) > FRAME_MOTION_MAX_M

    def _moved_since_frame_m(self, now: Odometry) -> float:
        mark = self._frame_mark
        if mark is None:
            return float("inf")
        return max(abs(now.left_m - mark.left_m), abs(now.right_m - mark.right_m))

    # --- modes ------------------------------------------------------------------------------------------------

    def change_mode(self, verb: safety.Verb, cause: str) -> safety.Decision:
        """Arm, start, pause, finish, acknowledge, reset, disarm. Stops are ``stop`` and ``emergency_stop``."""
        state, decision = safety.change_mode(self._state, verb, cause, self.inputs(), self._now_s())
        if state is not self._state:
            self._state = state
            self._on_mode(state)
        return decision

    async def stop(self, cause: str) -> tuple[PartStopped, ...]:
        """The operator's STOP: latch, close, halt, hold. Goes on past errors and reports each part."""
        self.change_mode(safety.Verb.STOP, cause)
        return await self._let_go()

    async def emergency_stop(self, cause: str) -> tuple[PartStopped, ...]:
        self.change_mode(safety.Verb.ESTOP, cause)
        return await self._let_go()

    async def _let_go(self) -> tuple[PartStopped, ...]:
        self._cut.set()
        self._pump_wanted = False
        self._base_commanded = False
        self._arm_settled = False
        parts: tuple[tuple[str, Callable[[], Awaitable[None]]], ...] = (
            ("valve", lambda: self._relay.cancel(Channel.VALVE)),
            ("base", self._wheels.stop),
            ("arm", self._arm.hold),
            ("pump", lambda: self._relay.cancel(Channel.PUMP)),
        )
        stopped = asyncio.gather(*(self._stop_part(name, action) for name, action in parts))
        return tuple(await asyncio.shield(stopped))

    async def _stop_part(self, name: str, action: Callable[[], Awaitable[None]]) -> PartStopped:
        error = ""
        for _ in range(CLOSE_TRIES):
            try:
                async with asyncio.timeout(CLOSE_DEADLINE_S):
                    await action()
            except (DeviceError, TimeoutError) as failure:
                error = str(failure) or "no answer in time"
            else:
                return PartStopped(name, "")
        return PartStopped(name, error)

    async def energise(self, lamp: bool) -> None:
        """Before arming: main contactor and beacon on, and the lamp when it is wanted."""
        wanted = {Channel.CONTACTOR, Channel.BEACON} | ({Channel.LAMP} if lamp else set())
        for channel in sorted(wanted & self._relay.channels):
            await self._relay.switch(channel, True)
        await self._arm.torque(True)
        await self.poll_arm()
        await self.poll_relay()

    async def de_energise(self) -> tuple[PartStopped, ...]:
        """Everything off at the relay board; the arm goes on holding."""
        self._pump_wanted = False
        return (await self._stop_part("relay board", self._relay.all_off),)

    # --- base and arm -----------------------------------------------------------------------------------------

    async def drive(self, speed_m_s: float, yaw_rate_rad_s: float) -> None:
        """One velocity command, good for the drive's command time-out; ``Refused`` with the reasons."""
        request = safety.MotionRequest("base", speed_m_s, yaw_rate_rad_s)
        self._demand(safety.authorise_motion(self._state, self.inputs(), request, self._limits, self._now_s()))
        self._base_commanded = speed_m_s != 0.0 or yaw_rate_rad_s != 0.0
        await self._wheels.drive(speed_m_s, yaw_rate_rad_s)

    async def halt_base(self) -> None:
        self._base_commanded = False
        await self._wheels.stop()

    async def move_arm(self, trajectory: JointTrajectory) -> None:
        """Follow to the end and wait until every joint has settled.

        ``Refused`` by safety, ``DeviceError`` from the arm or when it does not settle. Cancelled, the arm holds.
        """
        self._demand(
            safety.authorise_motion(
                self._state, self.inputs(), safety.MotionRequest("arm"), self._limits, self._now_s()
            )
        )
        self._arm_settled = False
        self._goal_rad = trajectory.goal_rad
        await self._arm.follow(trajectory)
        await self._settle()

    async def _settle(self) -> None:
        deadline_s = self._now_s() + self._settings.settle_timeout_s
        within_since_s: float | None = None
        while True:
            state = await self._arm.state()
            self._readings.arm = state
            if not self._within_tolerance(state):
                within_since_s = None
            elif within_since_s is None:
                within_since_s = state.stamp_s
            elif state.stamp_s - within_since_s >= self._settings.settle_s:
                self._arm_settled = True
                return
            if self._now_s() > deadline_s:
                goal = self._goal_rad or state.position_rad
                worst = max(abs(a - b) for a, b in zip(goal, state.position_rad, strict=True))
                raise DeviceError(
                    "arm",
                    f"every joint within {self._settings.settle_tolerance_rad} rad of its goal",
                    f"{worst:.3f} rad after {self._settings.settle_timeout_s} s",
                    "look for something that blocks the arm",
                )
            await asyncio.sleep(0.02)

    def _within_tolerance(self, state: ArmState) -> bool:
        goal = self._goal_rad or state.position_rad
        return all(
            abs(a - b) <= self._settings.settle_tolerance_rad for a, b in zip(goal, state.position_rad, strict=True)
        )

    # --- liquid -----------------------------------------------------------------------------------------------

    async def start_pump(self) -> None:
        """Ask for pressure. The pump runs on leases: it stops by itself when nobody renews them."""
        self._demand(self._pump_decision())
        self._pump_wanted = True
        await self._renew_pump(self._settings.pump_lease_s / 2)

    async def stop_pump(self) -> None:
        self._pump_wanted = False
        self._pump_until_s = 0.0
        await self._relay.cancel(Channel.PUMP)

    def _pump_decision(self) -> safety.Decision:
        armed = self._state.mode in (safety.Mode.AUTO, safety.Mode.MANUAL)
        return safety.Decision(() if armed else (f"mode is {self._state.mode}",))

    async def _renew_pump(self, at_least_s: float) -> None:
        if self._pump_until_s - self._now_s() < at_least_s and self._pump_decision().allowed:
            receipt = await self._relay.pulse(Channel.PUMP, self._settings.pump_lease_s)
            self._pump_until_s = receipt.sent_s + receipt.duration_s

    async def spray(self, order: PulseOrder) -> Result:
        """Open the valve once and account for it.

        Safety is asked, the intent is durable before the valve opens, the close is not cancellable, the outcome is
        booked from the flow meter. ``Refused`` or a ledger error before anything opened. When the caller is cancelled
        the valve is shut at once, the shortened shot is booked, and then the cancellation goes on.
        """
        if self._task_id is None:
            raise Refused("no task is open in the ledger; begin one before spraying")
        await self._renew_pump(order.pulse_s + 1.0)
        request = safety.SprayRequest(order.target_id, order.dose_ml, order.full_ml, order.open_s, order.pulse_s)
        self._state, decision = safety.authorise_spray(
            self._state, self.inputs(), request, self._limits, self._now_s()
        )
        self._demand(decision)
        self._cut.clear()
        self._shot_under_way = True
        section = asyncio.create_task(self._account_for(order, self._task_id), name=f"shot at target {order.target_id}")
        cancelled = False
        while not section.done():
            try:
                await asyncio.shield(section)
            except asyncio.CancelledError:
                cancelled = True
                self._cut.set()
            except Exception:  # noqa: BLE001 - the section's own error: raised by section.result() below
                break
        if cancelled:
            if (error := section.exception()) is not None:
                raise asyncio.CancelledError(str(error)) from error
            raise asyncio.CancelledError
        return section.result()

    async def _account_for(self, order: PulseOrder, task_id: int) -> Result:
        """From intent to outcome; never cancelled, ends by its own deadlines."""
        booked_ml = order.full_ml
        try:
            intent = Intent(
                target_id=order.target_id, stop=order.stop, pulse=order.number, due_ml=order.due_ml,
                dose_ml=order.dose_ml, open_s=order.open_s, pulse_s=order.pulse_s, full_ml=order.full_ml,
                stamp_s=self._now_s(),
            )
            try:
                intent_id = await work(lambda: self._ledger.write_intent(task_id, intent), LEDGER_WRITE_S)
            except Exception:
                booked_ml = 0.0  # nothing was opened
                raise
            result = await self._open_and_close(order)
            booked_ml = result.booked_ml
            await work(lambda: self._ledger.write_result(intent_id, result), LEDGER_WRITE_S)
            return result
        except Exception as error:
            await self.stop(f"the shot at target {order.target_id} could not be accounted for: {error}")
            raise
        finally:
            self._state = safety.settle_booking(self._state, order.target_id, booked_ml, self._now_s())
            self._tank_left_ml -= booked_ml
            self._shot_under_way = False

    async def _open_and_close(self, order: PulseOrder) -> Result:
        last_look = safety.still_allowed(self._state, self.inputs(), self._now_s())
        if self._cut.is_set() or not last_look.allowed:
            reason = "; ".join(last_look.reasons) or "stopped before the valve opened"
            return Result(Outcome.NOT_OPENED, 0.0, 0.0, None, reason, self._now_s())
        problem = ""
        opened_s = self._now_s()
        try:
            receipt = await self._relay.pulse(Channel.VALVE, order.open_s)
            opened_s = receipt.sent_s
            shut_at_s = opened_s + min(order.open_s, receipt.duration_s)
            try:
                async with asyncio.timeout_at(shut_at_s):
                    await self._cut.wait()
            except TimeoutError:
                pass
        except DeviceError as error:
            problem = f"open unconfirmed: {error}"
        shut_s = self._now_s()
        closing = await self._stop_part("valve", lambda: self._relay.cancel(Channel.VALVE))
        if not closing.error:
            closing = await self._stop_part("valve", self._read_back_shut)
        if closing.error:
            problem = f"{problem} close unconfirmed: {closing.error}".strip()
            await self._stop_part("contactor", lambda: self._relay.switch(Channel.CONTACTOR, False))
            await self.stop(f"the valve's closing is unconfirmed ({closing.error})")
        return await self._book(order, shut_s - opened_s, problem)

    async def _read_back_shut(self) -> None:
        self._readings.relay = await self._relay.read()
        if self._readings.relay.coils.get(Channel.VALVE, True):
            raise DeviceError("relay", "the valve's coil off", "on", "check the board for a welded contact")

    async def _book(self, order: PulseOrder, open_s: float, problem: str) -> Result:
        measured_ml, upper_ml = await self._read_meter()
        now_s = self._now_s()
        if problem:
            booked_ml = max(order.full_ml, upper_ml or 0.0)
            return Result(Outcome.UNCERTAIN, booked_ml, open_s, measured_ml, problem, now_s)
        model_ml = order.model_ml * open_s / order.open_s
        if measured_ml is None or upper_ml is None:
            return Result(Outcome.SPRAYED, order.full_ml, open_s, None, "no flow reading: booked the full pulse", now_s)
        shortened = open_s < 0.95 * order.open_s
        outcome = Outcome.SHORTENED if shortened else Outcome.SPRAYED
        if not shortened and measured_ml < 0.7 * model_ml - self._settings.meter_ml_per_pulse:
            reason = f"flow meter saw {measured_ml:.2f} of {model_ml:.2f} ml: check nozzle, filter and meter"
            return Result(outcome, max(order.full_ml, upper_ml), open_s, measured_ml, reason, now_s)
        return Result(outcome, upper_ml, open_s, measured_ml, "shortened by a stop" if shortened else "", now_s)

    async def _read_meter(self) -> tuple[float | None, float | None]:
        """(measured ml, ml to book): one pulse ahead of the count, wider by the meter's tolerance."""
        await asyncio.sleep(self._settings.valve_close_s + METER_SETTLE_S)
        before_ml = self._accounted_to_ml
        try:
            reading = await self._inputs.read()
        except DeviceError:
            return None, None  # the poll of the sensors reports the fault itself
        self._readings.sensors = reading
        count_ml = reading.flow_total_ml + self._settings.meter_ml_per_pulse
        if before_ml is None or count_ml < before_ml:
            self._accounted_to_ml = count_ml
            return None, None
        self._accounted_to_ml = count_ml
        measured_ml = count_ml - before_ml
        return measured_ml, measured_ml * (1.0 + self._settings.meter_tolerance)

    async def begin_metering(self) -> None:
        """Start the flow account at the meter's present count."""
        reading = await self._inputs.read()
        self._readings.sensors = reading
        self._accounted_to_ml = reading.flow_total_ml

    # --- small helpers ----------------------------------------------------------------------------------------

    def _demand(self, decision: safety.Decision) -> None:
        if not decision.allowed:
            raise Refused("; ".join(decision.reasons))

    def _now_s(self) -> float:
        return asyncio.get_running_loop().time()

"""Two hub motors on a ZLAC8015D controller, over Modbus."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable
from concurrent.futures import Future

from drivers.errors import DeviceError, DeviceFault, DeviceLost, DeviceRefused, DeviceTimeout
from drivers.modbus_master import ModbusLine, ModbusMaster, ModbusUnit
from drivers.stop_lane import StopLane
from drivers.wheels import zlac_registers as r
from drivers.wheels import zlac_talk as talk
from drivers.wheels.drive_geometry import LongCount, WheelPair, rpm_of, speed_of, wheel_speeds
from drivers.wheels.rpm_steps import RpmSteps
from drivers.wheels.values import Odometry
from drivers.wheels.zlac_diagnostics import Zlac8015dDiagnostics, diagnose
from drivers.wheels.zlac_settings import Zlac8015dSettings
from drivers.wheels.zlac_talk import DEVICE, persist

STANDSTILL_EVERY_S = 0.05
STANDSTILL_SPARE_S = 1.0


class Zlac8015dWheels:
    """Implements ``drivers.wheels.interface.Wheels``; ``clock`` gives loop time.

    Two time-outs stop the base: the controller's, which any frame for it holds off, and the driver's own on the event
    loop, which only ``drive`` does; with the loop dead no frame comes any more. Speeds between whole rpm are made by
    commanding the steps below and above in turn (``RpmSteps``). A fault of the controller is a ``DeviceFault`` of every
    reading and is cleared by ``clear_alarm`` only.
    """

    def __init__(self, settings: Zlac8015dSettings, master: ModbusMaster, clock: Callable[[], float]) -> None:
        self._settings, self._master, self._clock = settings, master, clock
        self._mounting = settings.mounting
        self._steps = WheelPairOfSteps(settings.command_timeout_s)
        self._is_open = False
        self._stops = 0  # counted, so that a drive command that a stop overtook is not sent after it
        self._moving = False
        self._lapse: asyncio.TimerHandle | None = None
        self._lapse_error: DeviceError | None = None
        self._counts: tuple[LongCount, LongCount] | None = None
        self.stop_lane = StopLane(DEVICE, self.post_halt, self._force_halt)

    @property
    def track_m(self) -> float:
        return self._settings.track_m

    @property
    def command_timeout_s(self) -> float:
        return self._settings.command_timeout_s

    async def open(self) -> None:
        """Prove by reads what answers, command 0, set the controller up, enable it.

        ``DeviceMissing``, ``WrongDevice``; ``DeviceFault`` for an alarm, or for a controller that does not take its
        time-out: it could not be driven unattended.
        """
        self._counts, self._lapse_error = None, None
        await self._master.attach(DEVICE, self._greet)
        self._is_open = True

    async def close(self) -> None:
        """Stop; once the wheels stand, release them. ``DeviceFault`` when they do not come to a stand."""
        if not self._is_open:
            return
        try:
            await self.stop()
            await self._stand()
            await self._master.run(lambda line: talk.control(self._unit(line), r.Control.DISABLE))
        finally:
            self._is_open = False
            self._expect_renewal(False)
            await self._master.detach(DEVICE)

    async def drive(self, speed_m_s: float, yaw_rate_rad_s: float) -> None:
        if not (math.isfinite(speed_m_s) and math.isfinite(yaw_rate_rad_s)):
            raise DeviceRefused(
                DEVICE, "finite speeds", f"{speed_m_s} m/s and {yaw_rate_rad_s} rad/s", "command 0 to stand still"
            )
        self._require_open()
        moves = speed_m_s != 0.0 or yaw_rate_rad_s != 0.0
        if moves:
            self.stop_lane.require_released()
        self._expect_renewal(moves)
        stops, asked_s = self._stops, self._clock()

        def job(line: ModbusLine) -> None:
            if stops != self._stops:
                raise DeviceRefused(DEVICE, "no stop since the command", "one", "command anew")
            if (age_s := self._clock() - asked_s) >= self.command_timeout_s:
                raise DeviceTimeout(
                    DEVICE, f"the bus within {self.command_timeout_s:g} s", f"it busy for {age_s:.1f} s",
                    "look for a silent device on the same bus",
                )  # fmt: skip
            self._drive(line, wheel_speeds(speed_m_s, yaw_rate_rad_s, self.track_m, self._settings.max_speed_m_s))

        await self._master.run(job)

    async def stop(self) -> None:
        """Brake to standstill, before all that waits for the bus; by the emergency stop when 0 is not acknowledged."""
        self._overtake()
        await self._master.stop(self._halt)

    def post_halt(self) -> Future[None]:
        """Like ``stop``, from any thread and without waiting."""
        self._stops += 1
        return self._master.post_stop(self._halt)

    def _force_halt(self) -> None:
        """Speed 0 beside an owner that hangs."""
        self._master.write_beside(self._settings.unit_id, [talk.command_request(0, 0)])

    async def emergency_stop(self) -> None:
        """The controller's own emergency stop; the next ``drive`` leaves it."""
        self._overtake()

        def job(line: ModbusLine) -> None:
            self._stand_down()
            talk.control(self._unit(line), r.Control.EMERGENCY_STOP)

        await self._master.stop(job)

    async def clear_alarm(self) -> None:
        """Clear a latched alarm and set the controller up anew, at rest. ``DeviceFault`` while its cause is there."""
        self._overtake()

        def job(line: ModbusLine) -> None:
            self._stand_down()
            unit = self._unit(line)
            talk.command(unit, 0, 0)
            talk.control(unit, r.Control.CLEAR_ALARM)
            talk.set_up(unit, self._settings)

        await self._master.run(job)

    async def odometry(self) -> Odometry:
        self._require_open()
        if self._lapse_error is not None:
            error, self._lapse_error = self._lapse_error, None
            raise error
        return await self._master.run(self._read_odometry)

    async def diagnostics(self) -> Zlac8015dDiagnostics:
        """Supply, temperatures, currents, states and faults, as the controller reports them."""
        self._require_open()
        return await self._master.run(lambda line: diagnose(self._unit(line), self._settings))

    # --- in the owner thread ----------------------------------------------------------------------------------

    def _unit(self, line: ModbusLine) -> ModbusUnit:
        return line.unit(DEVICE, self._settings.unit_id)

    def _greet(self, line: ModbusLine) -> None:
        self._stand_down()
        unit = self._unit(line)
        talk.prove_identity(unit, self._settings.unit_id)
        talk.set_up(unit, self._settings)

    def _drive(self, line: ModbusLine, wheels_m_s: WheelPair) -> None:
        unit = self._unit(line)
        if wheels_m_s == WheelPair(0.0, 0.0):
            self._stand_down()
            talk.command(unit, 0, 0)
            return
        if not self._moving:
            self._begin(unit)
        radius_m = self._settings.radius_m
        channels = self._mounting.channels(
            WheelPair(rpm_of(wheels_m_s.left, radius_m), rpm_of(wheels_m_s.right, radius_m))
        )
        self._moving = True
        talk.command(unit, *self._steps.next(channels, self._clock()))

    def _begin(self, unit: ModbusUnit) -> None:
        """Before the wheels turn: the controller is as it was set up, without a fault, at 0, and enabled."""
        if not talk.still_set_up(unit, self._settings):
            talk.set_up(unit, self._settings)
            return
        talk.command(unit, 0, 0)
        talk.require_no_faults(talk.read_faults(unit), self._settings)
        talk.control(unit, r.Control.ENABLE)

    def _halt(self, line: ModbusLine) -> None:
        self._stand_down()
        talk.halt(self._unit(line))

    def _stand_down(self) -> None:
        """Nothing is to move from here on."""
        self._moving = False
        self._steps.reset()

    def _read_odometry(self, line: ModbusLine) -> Odometry:
        unit = self._unit(line)

        def read() -> tuple[float, list[int], float]:
            return self._clock(), unit.read_holding(r.FIRST_ODOMETRY, r.ODOMETRY_WORDS), self._clock()

        asked_s, words, told_s = persist(read)
        raw = WheelPair(r.signed_32(words[2], words[3]), r.signed_32(words[4], words[5]))
        if self._counts is None:
            self._counts = (LongCount(int(raw.left)), LongCount(int(raw.right)))
        left, right = self._counts
        counted = self._mounting.wheels(WheelPair(left.follow(int(raw.left)), right.follow(int(raw.right))))
        rpm = self._mounting.wheels(WheelPair(0.1 * r.signed_16(words[6]), 0.1 * r.signed_16(words[7])))
        talk.require_no_faults(words[:2], self._settings)
        return Odometry(
            stamp_s=0.5 * (asked_s + told_s),
            left_m=counted.left * self._settings.count_m,
            right_m=counted.right * self._settings.count_m,
            left_m_s=speed_of(rpm.left, self._settings.radius_m),
            right_m_s=speed_of(rpm.right, self._settings.radius_m),
        )

    # --- on the event loop ------------------------------------------------------------------------------------

    def _overtake(self) -> None:
        """What has been commanded and not sent will not be."""
        self._require_open()
        self._stops += 1
        self._expect_renewal(False)

    def _expect_renewal(self, moving: bool) -> None:
        if self._lapse is not None:
            self._lapse.cancel()
        loop = asyncio.get_running_loop()
        self._lapse = loop.call_later(self.command_timeout_s, self._command_lapsed) if moving else None

    def _command_lapsed(self) -> None:
        self._lapse = None
        self._master.post_stop(self._halt).add_done_callback(self._lapse_done)

    def _lapse_done(self, halted: Future[None]) -> None:
        """A base that could not be halted is told of at the next reading; a lost port tells of itself."""
        error = halted.exception()
        if isinstance(error, DeviceError) and not isinstance(error, DeviceLost):
            self._lapse_error = error

    async def _stand(self) -> None:
        """Wait until both wheels stand."""
        settings = self._settings
        deadline_s = self._clock() + settings.max_speed_m_s / settings.deceleration_m_s2 + STANDSTILL_SPARE_S
        while True:
            rpm = await self._master.run(
                lambda line: persist(lambda: self._unit(line).read_holding(r.LEFT_SPEED.address, 2))
            )
            if rpm == [0, 0]:
                return
            if self._clock() > deadline_s:
                raise DeviceFault(
                    DEVICE, "standstill", f"wheels at {', '.join(f'{0.1 * r.signed_16(w):.1f}' for w in rpm)} rpm",
                    "press the e-stop; the wheels were not released",
                )  # fmt: skip
            await asyncio.sleep(STANDSTILL_EVERY_S)

    def _require_open(self) -> None:
        if not self._is_open:
            raise DeviceLost(DEVICE, "an open connection", "a closed one", "open the device first")


class WheelPairOfSteps:
    """``RpmSteps`` of both channels."""

    def __init__(self, longest_s: float) -> None:
        self._left, self._right = RpmSteps(longest_s), RpmSteps(longest_s)

    def next(self, rpm: WheelPair, now_s: float) -> tuple[int, int]:
        return self._left.next(rpm.left, now_s), self._right.next(rpm.right, now_s)

    def reset(self) -> None:
        self._left.reset()
        self._right.reset()

"""All servos of the arm on their line: what the driver does with them, in the owner thread of the port."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial

from drivers.arm import register_blocks as blocks
from drivers.arm.control_tables import (
    ACCELERATION_UNIT_RAD_S2,
    RETURN_DELAY_UNIT_S,
    VELOCITY_UNIT_RAD_S,
    VOLTAGE_UNIT_V,
    WATCHDOG_UNIT_S,
    hardware_error_text,
)
from drivers.arm.handshake import Identity, identify
from drivers.arm.joints import DynamixelSettings
from drivers.arm.register_blocks import Climate, Condition, Motion, int32
from drivers.arm.servo_health import Cadence, ServoHealth
from drivers.arm.servo_line import DEVICE, Answers, ServoLine
from drivers.arm.stopping import Stop, Stream
from drivers.arm.values import ArmState
from drivers.errors import DeviceError, DeviceFault, DeviceRefused, DeviceTimeout
from drivers.line import Line

PROBE_PATIENCE_S = 0.012
SILENCES = 3  # of the whole bus in a row, until a trajectory ends
PING_AGAIN_S = 1.0
CLIMATE_EVERY = 5  # polls
VELOCITY_HEADROOM = 1.25  # of a servo's own velocity limit over the trajectories'
LONGEST_GAP_S = 0.2  # between two goals: after a longer one the arm does not leap to catch up


class ServoGroup:
    """Its methods that take a ``Line`` are jobs of the port. Faults of servos stay until ``forget``."""

    def __init__(self, settings: DynamixelSettings, clock: Callable[[], float]) -> None:
        self.settings = settings
        self.health = {
            servo.servo_id: ServoHealth(servo.servo_id, joint.name, servo.model)
            for joint in settings.joints
            for servo in joint.servos
        }
        self.cadence = Cadence(settings.cycle_s)
        self.garbled = self.silences = 0
        self.notes: tuple[str, ...] = ()
        self._clock = clock
        self._joints = tuple(
            (joint, [(servo, servo.table.effort_at_stall) for servo in joint.servos]) for joint in settings.joints
        )
        self._servos: ServoLine | None = None
        self._watchdog = math.ceil(settings.watchdog_s / WATCHDOG_UNIT_S - 1e-9)
        self._armed = False
        self._silent = self._polls = 0
        self._pinged_s = -math.inf
        self._stream = Stream()
        self._latest: ArmState | None = None
        velocity = math.ceil(VELOCITY_HEADROOM * settings.max_velocity_rad_s / VELOCITY_UNIT_RAD_S)
        acceleration = max(1, round(settings.max_acceleration_rad_s2 / ACCELERATION_UNIT_RAD_S2))
        self._stream_profile = int32(0) + int32(velocity)
        self._move_profile = int32(acceleration) + int32(velocity)

    # --- coming and going

    def forget(self) -> None:
        """Begin anew: no servo is dead or has been rebooted."""
        for health in self.health.values():
            health.alive, health.rebooted, health.misses, health.tick = True, False, 0, None
        self._armed = False
        self._latest = None

    def greet(self, line: Line) -> None:
        """Prove who is there, then set what does not move: return delay and bus watchdog."""
        servos = ServoLine(line)
        rows = identify(servos, self.settings)
        self._servos, self._silent, self.notes = servos, 0, ()
        for row in rows:
            self._take_up(servos, row)
        self._armed = True

    def _take_up(self, servos: ServoLine, row: Identity) -> None:
        health, table = self.health[row.servo_id], row.expected.table
        condition = Condition.of(servos.read(row.servo_id, blocks.HEALTH_ADDRESS, blocks.HEALTH_BYTES))
        assert row.found is not None
        health.firmware, health.alive, health.misses, health.tick = row.found.firmware, True, 0, None
        health.rebooted |= self._armed and condition.watchdog == 0
        self._note_condition(health, condition)
        delay = row.settings["return_delay_time"]
        if delay and self.settings.writes_return_delay and not condition.torque_on:
            servos.write_register(row.servo_id, table.register("return_delay_time"), 0)
            delay = 0
        health.return_delay_s = delay * RETURN_DELAY_UNIT_S
        if delay:
            self.notes += (
                f"servo {row.servo_id} answers {1e6 * health.return_delay_s:.0f} us late: "
                "set return_delay_time to 0 with its torque off",
            )
        self._arm_watchdog(servos, health, condition.watchdog)

    def _arm_watchdog(self, servos: ServoLine, health: ServoHealth, found: int) -> None:
        """Clear it and set it. A servo that it has stopped takes its place as its goal, whatever that was before."""
        servos.write(health.servo_id, blocks.WATCHDOG_ADDRESS, b"\0")
        if found == blocks.WATCHDOG_TRIPPED and health.torque_on:
            place = servos.read(health.servo_id, blocks.POSITION_ADDRESS, blocks.POSITION_BYTES)
            servos.write(health.servo_id, blocks.PROFILE_ADDRESS, self._move_profile + place)
        servos.write(health.servo_id, blocks.WATCHDOG_ADDRESS, bytes([self._watchdog]))

    def leave(self, line: Line) -> None:
        """Disarm the watchdogs; torque as the policy says. Goes on past servos that do not answer."""
        servos = self._line()
        self._armed = False
        if self.settings.torque_on_close == "off":
            servos.sync_write(blocks.TORQUE_ADDRESS, dict.fromkeys(self.health, b"\0"))
        servos.sync_write(blocks.WATCHDOG_ADDRESS, dict.fromkeys(self.health, b"\0"))
        left = servos.sync_read(blocks.HEALTH_ADDRESS, blocks.HEALTH_BYTES, self._alive())
        still = [servo_id for servo_id, data in left.data.items() if Condition.of(data).watchdog]
        for servo_id in [*still, *left.missing]:
            self._try(partial(servos.write, servo_id, blocks.WATCHDOG_ADDRESS, b"\0"))

    # --- reading

    def read_state(self, line: Line) -> ArmState:
        """A fresh reading of everything. ``DeviceTimeout`` or ``DeviceFault`` names the joint that cannot be read."""
        servos = self._line()
        self._require_alive()
        self._read_condition(servos)
        for attempt in (1, 2):
            stamp_s = self._clock()
            answers = servos.sync_read(blocks.MOTION_ADDRESS, blocks.MOTION_BYTES, self._alive(), fast=self._fast)
            if not answers.missing:
                return self._state(stamp_s, answers)
            if attempt == 2 or not answers.garbled:
                self._note_missing(servos, answers)
        raise self._unanswered(answers)

    def _read_condition(self, servos: ServoLine) -> None:
        answers = servos.sync_read(blocks.HEALTH_ADDRESS, blocks.HEALTH_BYTES, self._alive())
        if answers.missing:
            answers = servos.sync_read(blocks.HEALTH_ADDRESS, blocks.HEALTH_BYTES, self._alive())
        for servo_id, data in answers.data.items():
            self._note_condition(self.health[servo_id], Condition.of(data))
        if answers.missing:
            self._note_missing(servos, answers)
            raise self._unanswered(answers)

    def recent_state(self, longest_s: float) -> ArmState | None:
        """The reading of the last cycle, unless it is older. From any thread."""
        latest = self._latest
        return latest if latest is not None and self._clock() - latest.stamp_s <= longest_s else None

    # --- moving

    def begin_stream(self, line: Line) -> None:
        """Goals will come in a stream: the servos follow each at once, no faster than a bound."""
        servos = self._line()
        self.require_sound()
        servos.sync_write(blocks.PROFILE_ADDRESS, dict.fromkeys(self.health, self._stream_profile))
        self._stream = Stream()
        self.cadence.begin()

    def cycle(self, line: Line, goal_rad: Sequence[float]) -> None:
        """Goals of all joints out, a reading of all in. Raises when the arm can follow no further."""
        servos, now_s = self._line(), self._clock()
        if (gap_s := self.cadence.note(now_s)) > LONGEST_GAP_S and not self._silent:
            raise DeviceFault(
                DEVICE, f"a goal at least every {LONGEST_GAP_S:g} s", f"a pause of {gap_s:.2f} s",
                "the computer is too busy, or the port too slow; plan from where the arm is",
            )  # fmt: skip
        self._stream.note(now_s, goal_rad)
        ticks = self.settings.ticks_of(goal_rad)
        servos.sync_write(blocks.GOAL_ADDRESS, {servo_id: int32(tick) for servo_id, tick in ticks.items()})
        stamp_s = self._clock()
        answers = servos.sync_read(blocks.MOTION_ADDRESS, blocks.MOTION_BYTES, self._alive(), fast=self._fast)
        if answers.missing and answers.garbled:
            stamp_s = self._clock()
            answers = servos.sync_read(blocks.MOTION_ADDRESS, blocks.MOTION_BYTES, self._alive(), fast=self._fast)
            if answers.missing and answers.garbled:
                self.garbled += 1
                raise self._unanswered(answers)
        if answers.alerts:
            self._read_errors(servos, answers.alerts)
        if answers.missing:
            self._note_missing(servos, answers)
            if self._silent >= SILENCES:
                raise self._unanswered(answers)
        else:
            self._silent = 0
            self._latest = self._state(stamp_s, answers)
        self.require_sound()
        self.require_working()

    def brake(self, line: Line) -> None:
        """Stop every servo that moves and let it hold. Best effort over all; raises what did not answer, afterwards."""
        self._latest = None
        streamed, self._stream = self._stream.motion(self._clock()), Stream()
        Stop(self._line(), self.settings, self._move_profile, self._clock).do(streamed)

    def torque(self, line: Line, on: bool) -> None:
        """Torque on takes the present place as the goal first. Off goes on past servos that do not answer."""
        servos, everyone = self._line(), tuple(self.health)
        self._latest = None
        if on:
            self.require_sound()
            self._read_condition(servos)
            limp = [servo_id for servo_id, health in self.health.items() if not health.torque_on]
            if not limp:
                return
            self._aim_at_present(servos, limp)
            everyone = tuple(limp)
        for _ in range(2):
            servos.sync_write(blocks.TORQUE_ADDRESS, dict.fromkeys(everyone, bytes([on])))
            answers = servos.sync_read(blocks.HEALTH_ADDRESS, blocks.HEALTH_BYTES, everyone)
            for servo_id, data in answers.data.items():
                self._note_condition(self.health[servo_id], Condition.of(data))
            others = [i for i in everyone if i not in answers.data or self.health[i].torque_on != on]
            if not others:
                return
        wanted = "on" if on else "off"
        raise DeviceFault(
            DEVICE, f"torque {wanted}", f"not so at {self._names(others)}",
            "look at those servos: a hardware error keeps torque off until the servo is rebooted",
        )  # fmt: skip

    def _aim_at_present(self, servos: ServoLine, servo_ids: Sequence[int]) -> None:
        """Goal is place, for servos without torque."""
        answers = servos.sync_read(blocks.POSITION_ADDRESS, blocks.POSITION_BYTES, servo_ids)
        if answers.missing:
            raise self._unanswered(answers)
        for servo_id, place in answers.data.items():
            servos.write(servo_id, blocks.PROFILE_ADDRESS, self._move_profile + place)

    # --- watching

    def poll(self, line: Line) -> None:
        """Looks after the servos and keeps their watchdogs quiet. Raises only when the device is gone."""
        servos = self._line()
        self._polls += 1
        answers = servos.sync_read(blocks.HEALTH_ADDRESS, blocks.HEALTH_BYTES, self._alive())
        for servo_id, data in answers.data.items():
            health, condition = self.health[servo_id], Condition.of(data)
            health.answered()
            self._note_condition(health, condition)
            self._mind_watchdog(servos, health, condition.watchdog)
        if answers.missing:
            self._note_missing(servos, answers)
        else:
            self._silent = 0
        if self._polls % CLIMATE_EVERY == 0:
            self._read_climate(servos)
        if self._clock() - self._pinged_s >= PING_AGAIN_S:
            self._ping_dead(servos)

    def _mind_watchdog(self, servos: ServoLine, health: ServoHealth, found: int) -> None:
        if found == self._watchdog or not self._armed:
            return
        if found == 0:
            health.rebooted = True
        if found == blocks.WATCHDOG_TRIPPED:
            health.watchdog_trips += 1
        self._try(lambda: self._arm_watchdog(servos, health, found))

    def _read_climate(self, servos: ServoLine) -> None:
        at_s = self._clock()
        answers = servos.sync_read(blocks.CLIMATE_ADDRESS, blocks.CLIMATE_BYTES, self._alive())
        for servo_id, data in answers.data.items():
            health, climate = self.health[servo_id], Climate.of(data)
            health.note_tick(climate.tick, at_s)
            health.voltage_v, health.temperature_c = VOLTAGE_UNIT_V * climate.voltage, float(climate.temperature)

    def _ping_dead(self, servos: ServoLine) -> None:
        """One of the dead, in turn; who answers again is one of the arm's once more."""
        self._pinged_s = self._clock()
        dead = [health for health in self.health.values() if not health.alive]
        if not dead:
            return
        health = dead[self._polls % len(dead)]

        def revive() -> None:
            condition = Condition.of(servos.read(health.servo_id, blocks.HEALTH_ADDRESS, blocks.HEALTH_BYTES))
            self._note_condition(health, condition)
            self._mind_watchdog(servos, health, condition.watchdog)
            health.alive, health.misses, health.tick = True, 0, None

        self._impatiently(servos, revive)

    def _note_missing(self, servos: ServoLine, answers: Answers) -> None:
        """Who is it? After a servo that is silent, those behind it in the same read may not answer either."""
        if not answers.data:
            self.silences += not answers.garbled
            self._silent += 1
            if self._silent == 1 or answers.garbled:
                return
        there = [i for i in answers.missing if self._impatiently(servos, partial(servos.ping, i))]
        if not there and not answers.data:
            return
        self._silent = 0
        for servo_id in answers.missing:
            if servo_id in there:
                self.health[servo_id].answered()
            else:
                self.health[servo_id].missed()

    def _read_errors(self, servos: ServoLine, servo_ids: set[int]) -> None:
        for servo_id in servo_ids:
            data = servos.read(servo_id, blocks.HEALTH_ADDRESS, blocks.HEALTH_BYTES)
            self._note_condition(self.health[servo_id], Condition.of(data))

    # --- what is known

    def require_sound(self) -> None:
        """No servo is dead or has been rebooted."""
        self._require_alive()
        for health in self.health.values():
            if health.rebooted:
                raise DeviceFault(
                    DEVICE, f"{health.joint} to have kept its power and its settings",
                    f"servo {health.servo_id} rebooted",
                    "look for a loose cable or a low supply there, then open the arm again",
                )  # fmt: skip

    def require_working(self) -> None:
        """Torque on and no hardware error, as last seen."""
        for name, error in zip(self.settings.joint_names, self._errors(), strict=True):
            if error:
                found = f"{name} reports {hardware_error_text(error)}"
                raise DeviceFault(DEVICE, "servos without errors", found, "look at that servo, then reboot it")
        if not all(health.torque_on for health in self.health.values()):
            raise DeviceFault(DEVICE, "torque on", "torque off", "switch torque on when nobody is near the arm")

    def _require_alive(self) -> None:
        dead = [health.servo_id for health in self.health.values() if not health.alive]
        if dead:
            raise DeviceTimeout(
                DEVICE, "an answer of every servo", f"silence of {self._names(dead)}",
                "check the cable and the power there; it is asked again every second",
            )  # fmt: skip

    def _unanswered(self, answers: Answers) -> DeviceError:
        names = self._names(answers.missing)
        if answers.garbled:
            self.garbled += 1
            expected = f"valid answers of {names}"
            return DeviceFault(DEVICE, expected, "a garbled answer", "check the cable and its shield")
        return DeviceTimeout(
            DEVICE, f"answers of {names}", "silence", "check power and cable; where the arm is is unknown"
        )

    def _names(self, servo_ids: Sequence[int]) -> str:
        return ", ".join(f"{self.health[servo_id].joint} (servo {servo_id})" for servo_id in servo_ids)

    def _alive(self) -> list[int]:
        return [servo_id for servo_id, health in self.health.items() if health.alive]

    def _errors(self) -> tuple[int, ...]:
        """By joint, of all its servos."""
        errors = []
        for _, servos in self._joints:
            byte = 0
            for servo, _ in servos:
                byte |= self.health[servo.servo_id].hardware_error
            errors.append(byte)
        return tuple(errors)

    def _state(self, stamp_s: float, answers: Answers) -> ArmState:
        position, velocity, load = [], [], []
        motions: Mapping[int, Motion] = {servo_id: Motion.of(data) for servo_id, data in answers.data.items()}
        for _, servos in self._joints:
            first, _ = servos[0]
            motion = motions[first.servo_id]
            position.append(first.angle_of(motion.position))
            velocity.append(first.direction * motion.velocity * VELOCITY_UNIT_RAD_S)
            efforts = [servo.direction * motions[servo.servo_id].effort / stall for servo, stall in servos]
            load.append(min(max(sum(efforts) / len(efforts), -1.0), 1.0))
        return ArmState(
            stamp_s=stamp_s,
            position_rad=tuple(position),
            velocity_rad_s=tuple(velocity),
            load=tuple(load),
            torque_on=all(health.torque_on for health in self.health.values()),
            hardware_error=self._errors(),
        )

    @property
    def _fast(self) -> bool:
        return self.settings.fast_sync_read

    @staticmethod
    def _note_condition(health: ServoHealth, condition: Condition) -> None:
        health.torque_on, health.hardware_error = condition.torque_on, condition.hardware_error

    def _line(self) -> ServoLine:
        if self._servos is None:
            raise DeviceRefused(DEVICE, "servos that have been identified", "none yet", "open the arm first")
        return self._servos

    def _impatiently(self, servos: ServoLine, step: Callable[[], object]) -> bool:
        with servos.patience(PROBE_PATIENCE_S):
            return self._try(step)

    @staticmethod
    def _try(step: Callable[[], object]) -> bool:
        """Whether it worked; what did not is seen by the next poll."""
        try:
            step()
        except (DeviceTimeout, DeviceFault):
            return False
        return True

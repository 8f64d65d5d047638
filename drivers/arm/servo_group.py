"""All servos of the arm on their line: what the driver does with them, in the owner thread of the port."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from drivers.arm import register_blocks as blocks
from drivers.arm.control_tables import ACCELERATION_UNIT_RAD_S2, RETURN_DELAY_UNIT_S, VELOCITY_UNIT_RAD_S
from drivers.arm.handshake import Identity, identify
from drivers.arm.joints import DynamixelSettings
from drivers.arm.register_blocks import Condition, int32
from drivers.arm.servo_health import Cadence
from drivers.arm.servo_line import DEVICE, Answers, ServoLine
from drivers.arm.servo_roster import ServoRoster
from drivers.arm.servo_watch import ServoWatch
from drivers.arm.stopping import Stop, Stream
from drivers.arm.values import ArmState
from drivers.errors import DeviceFault, DeviceRefused
from drivers.line import Line

LONGEST_BLIND_S = 0.3  # without a reading of all servos a trajectory ends
SILENCES = 3  # of the whole bus in a row, until a trajectory ends
VELOCITY_HEADROOM = 1.25  # of a servo's own velocity limit over the trajectories'
LONGEST_GAP_S = 0.25  # between two goals: after a longer one the arm does not leap to catch up


class ServoGroup:
    """Its methods that take a ``Line`` are jobs of the port."""

    def __init__(self, settings: DynamixelSettings, clock: Callable[[], float]) -> None:
        self.roster = ServoRoster(settings)
        self.cadence = Cadence(settings.cycle_s)
        self.notes: tuple[str, ...] = ()
        self._settings, self._clock = settings, clock
        self._servos: ServoLine | None = None
        self._stream, self._read_s = Stream(), 0.0
        self._latest: tuple[float, dict[int, bytes]] | None = None
        velocity = math.ceil(VELOCITY_HEADROOM * settings.max_velocity_rad_s / VELOCITY_UNIT_RAD_S)
        acceleration = max(1, round(settings.max_acceleration_rad_s2 / ACCELERATION_UNIT_RAD_S2))
        self._stream_profile = int32(0) + int32(velocity)
        self._rest_profile = int32(acceleration) + int32(velocity)
        self._watch = ServoWatch(self.roster, settings.watchdog_s, self._rest_profile, clock)

    # --- coming and going

    def forget(self) -> None:
        """Begin anew, as if no servo had ever failed."""
        self.roster.forget()
        self._watch.armed = False
        self._latest = None

    def greet(self, line: Line) -> None:
        """Prove who is there, then set what does not move: return delay and bus watchdog."""
        servos = ServoLine(line)
        rows = identify(servos, self._settings)
        self._servos, self._watch.silent, self.notes = servos, 0, ()
        for row in rows:
            self._take_up(servos, row)
        self._watch.armed = True

    def _take_up(self, servos: ServoLine, row: Identity) -> None:
        """Greeted again, a servo whose watchdog is off has been without power meanwhile."""
        health, table = self.roster.health[row.servo_id], row.expected.table
        raw = servos.read_surely(row.servo_id, blocks.HEALTH_ADDRESS, blocks.HEALTH_BYTES)
        condition = Condition.of(raw)
        self.roster.note({row.servo_id: raw})
        health.firmware = row.found.firmware if row.found else 0
        health.alive, health.misses, health.tick = True, 0, None
        health.rebooted |= self._watch.was_powerless(row.servo_id, condition.watchdog)
        delay = row.settings["return_delay_time"]
        if delay and self._settings.writes_return_delay and not condition.torque_on:
            servos.write_register(row.servo_id, table.register("return_delay_time"), 0)
            delay = 0
        health.return_delay_s = delay * RETURN_DELAY_UNIT_S
        if delay:
            self.notes += (
                f"servo {row.servo_id} answers {1e6 * health.return_delay_s:.0f} us late: "
                "set return_delay_time to 0 with its torque off",
            )
        self._watch.arm(servos, health, condition.watchdog)

    def leave(self, line: Line) -> None:
        """Disarm the watchdogs; torque as the policy says. Goes on past servos that do not answer."""
        servos = self._line()
        if self._settings.torque_on_close == "off":
            servos.sync_write(blocks.TORQUE_ADDRESS, dict.fromkeys(self.roster.health, b"\0"))
        self._watch.disarm(servos)

    # --- reading

    def read_state(self, line: Line) -> ArmState:
        """A fresh reading of everything. ``DeviceTimeout`` or ``DeviceFault`` names the joint that cannot be read."""
        servos = self._line()
        self.roster.require_alive()
        self.roster.note(self._read_all(servos, blocks.HEALTH_ADDRESS, blocks.HEALTH_BYTES).data)
        stamp_s = self._clock()
        motion = self._read_all(servos, blocks.MOTION_ADDRESS, blocks.MOTION_BYTES)
        return self.roster.state(stamp_s, motion.data)

    def _read_all(self, servos: ServoLine, address: int, size: int) -> Answers:
        """Of every servo, at the second attempt if need be."""
        answers = servos.sync_read(address, size, self.roster.alive)
        if answers.missing:
            answers = servos.sync_read(address, size, self.roster.alive)
        if answers.missing:
            self._watch.note_missing(servos, answers)
            raise self.roster.unanswered(answers)
        return answers

    def recent_state(self, longest_s: float) -> ArmState | None:
        """The reading of the last cycle, unless it is older. From any thread."""
        latest = self._latest
        if latest is None or self._clock() - latest[0] > longest_s:
            return None
        return self.roster.state(*latest)

    def poll(self, line: Line) -> None:
        """Raises only when the device is gone."""
        self._watch.poll(self._line())

    # --- moving

    def begin_stream(self, line: Line) -> None:
        """Goals will come in a stream: the servos follow each at once, no faster than a bound."""
        self.roster.require_sound()
        self._line().sync_write(blocks.PROFILE_ADDRESS, dict.fromkeys(self.roster.health, self._stream_profile))
        self._stream, self._read_s = Stream(), self._clock()
        self.cadence.begin()

    def cycle(self, line: Line, goal_rad: Sequence[float]) -> None:
        """Goals of all joints out, a reading of all in. Raises when the arm can follow no further."""
        servos, now_s = self._line(), self._clock()
        if (gap_s := self.cadence.note(now_s)) > LONGEST_GAP_S and not self._watch.silent:
            raise DeviceFault(
                DEVICE, f"a goal at least every {LONGEST_GAP_S:g} s", f"a pause of {gap_s:.2f} s",
                "the computer is too busy, or the port too slow; plan from where the arm is",
            )  # fmt: skip
        self._stream.note(now_s, goal_rad)
        ticks = self._settings.ticks_of(goal_rad)
        goals = {servo_id: int32(tick) for servo_id, tick in ticks.items()}
        servos.sync_write(blocks.GOAL_ADDRESS, goals, with_next=True)
        stamp_s, answers = self._read_motion(servos)
        if answers.alerts:
            for servo_id in answers.alerts:
                raw = servos.read(servo_id, blocks.HEALTH_ADDRESS, blocks.HEALTH_BYTES)
                self.roster.note({servo_id: raw})
        if answers.missing:
            self._watch.note_missing(servos, answers)
            blind_s = self._clock() - self._read_s
            if answers.garbled or self._watch.silent >= SILENCES or blind_s > LONGEST_BLIND_S:
                raise self.roster.unanswered(answers)
        else:
            self._watch.silent = 0
            self._read_s = stamp_s
            self._latest = stamp_s, answers.data
        self.roster.require_sound()
        self.roster.require_working()

    def end_stream(self, goal_rad: Sequence[float]) -> None:
        """The last goal is one to rest at: the servos brake for it by their own profile."""
        ticks = self._settings.ticks_of(goal_rad)
        goals = {servo_id: self._rest_profile + int32(tick) for servo_id, tick in ticks.items()}
        self._line().sync_write(blocks.PROFILE_ADDRESS, goals)
        self._stream = Stream()

    def _read_motion(self, servos: ServoLine) -> tuple[float, Answers]:
        """A garbled answer is asked for once more."""
        for _ in range(2):
            stamp_s = self._clock()
            answers = servos.sync_read(
                blocks.MOTION_ADDRESS, blocks.MOTION_BYTES, self.roster.alive, fast=self._settings.fast_sync_read
            )
            if not (answers.missing and answers.garbled):
                break
        return stamp_s, answers

    def brake(self, line: Line) -> None:
        """Stop every servo that moves and let it hold. Best effort over all; raises what did not answer, afterwards."""
        self._latest = None
        streamed, self._stream = self._stream.motion(self._clock()), Stream()
        Stop(self._line(), self._settings, self._rest_profile, self._clock).do(streamed)

    def torque(self, line: Line, on: bool) -> None:
        """Torque on takes the present place as the goal first. Off goes on past servos that do not answer."""
        servos, everyone = self._line(), list(self.roster.health)
        self._latest = None
        if on:
            self.roster.require_sound()
            self.roster.note(self._read_all(servos, blocks.HEALTH_ADDRESS, blocks.HEALTH_BYTES).data)
            everyone = self.roster.limp
            if not everyone:
                return
            self._aim_at_present(servos, everyone)
        for _ in range(2):
            servos.sync_write(blocks.TORQUE_ADDRESS, dict.fromkeys(everyone, bytes([on])))
            answers = servos.sync_read(blocks.HEALTH_ADDRESS, blocks.HEALTH_BYTES, everyone)
            self.roster.note(answers.data)
            others = [i for i in everyone if i in answers.missing or self.roster.health[i].torque_on != on]
            if not others:
                return
        wanted = "on" if on else "off"
        raise DeviceFault(
            DEVICE, f"torque {wanted}", f"not so at {self.roster.names_of(others)}",
            "look at those servos: a hardware error keeps torque off until the servo is rebooted",
        )  # fmt: skip

    def _aim_at_present(self, servos: ServoLine, servo_ids: Sequence[int]) -> None:
        """Goal is place, for servos without torque."""
        answers = servos.sync_read(blocks.POSITION_ADDRESS, blocks.POSITION_BYTES, servo_ids)
        if answers.missing:
            raise self.roster.unanswered(answers)
        for servo_id, place in answers.data.items():
            servos.write(servo_id, blocks.PROFILE_ADDRESS, self._rest_profile + place)

    def _line(self) -> ServoLine:
        if self._servos is None:
            raise DeviceRefused(DEVICE, "servos that have been identified", "none yet", "open the arm first")
        return self._servos

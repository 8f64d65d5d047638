"""Looking after the servos between and beside motions: who is there, who fares how, watchdogs kept quiet."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial

from drivers.arm import register_blocks as blocks
from drivers.arm.control_tables import VOLTAGE_UNIT_V, WATCHDOG_UNIT_S
from drivers.arm.register_blocks import Climate, Condition
from drivers.arm.servo_health import ServoHealth
from drivers.arm.servo_line import Answers, ServoLine
from drivers.arm.servo_roster import ServoRoster
from drivers.errors import DeviceFault, DeviceTimeout

PROBE_PATIENCE_S = 0.012
PING_AGAIN_S = 1.0
CLIMATE_EVERY = 5  # polls


class ServoWatch:
    """In the owner thread of the port. ``rest_profile``: registers 108 to 115 of a servo that takes its place as goal.

    ``silent`` counts the reads in a row that nobody answered.
    """

    def __init__(self, roster: ServoRoster, watchdog_s: float, rest_profile: bytes, clock: Callable[[], float]) -> None:
        self.armed = False
        self.silent = 0
        self._roster, self._rest_profile, self._clock = roster, rest_profile, clock
        self._units = math.ceil(watchdog_s / WATCHDOG_UNIT_S - 1e-9)
        self._half_armed: set[int] = set()  # the host cleared their watchdogs and is not sure that it set them again
        self._polls = 0
        self._pinged_s = -math.inf

    def poll(self, servos: ServoLine) -> None:
        """Torque, errors and watchdogs of all, now and then their climate; the dead are asked again."""
        self._polls += 1
        answers = servos.sync_read(blocks.HEALTH_ADDRESS, blocks.HEALTH_BYTES, self._roster.alive)
        self._roster.note(answers.data)
        for servo_id, raw in answers.data.items():
            health = self._roster.health[servo_id]
            health.answered()
            self._mind_watchdog(servos, health, Condition.of(raw).watchdog)
        if answers.missing:
            self.note_missing(servos, answers)
        else:
            self.silent = 0
        if self._polls % CLIMATE_EVERY == 0:
            self._read_climate(servos)
        if self._clock() - self._pinged_s >= PING_AGAIN_S:
            self._ask_dead(servos)

    def arm(self, servos: ServoLine, health: ServoHealth, found: int) -> None:
        """Clear the watchdog and set it. A servo that it has stopped takes its place as its goal first."""
        self._half_armed.add(health.servo_id)
        servos.write_surely(health.servo_id, blocks.WATCHDOG_ADDRESS, b"\0")
        if found == blocks.WATCHDOG_TRIPPED and health.torque_on:
            place = servos.read(health.servo_id, blocks.POSITION_ADDRESS, blocks.POSITION_BYTES)
            servos.write_surely(health.servo_id, blocks.PROFILE_ADDRESS, self._rest_profile + place)
        servos.write_surely(health.servo_id, blocks.WATCHDOG_ADDRESS, bytes([self._units]))
        self._half_armed.discard(health.servo_id)

    def was_powerless(self, servo_id: int, found: int) -> bool:
        """Whether the watchdog that was ``found`` was reset with all the RAM, and not by the host."""
        return self.armed and found == 0 and servo_id not in self._half_armed

    def disarm(self, servos: ServoLine) -> None:
        """All watchdogs off; goes on past servos that do not answer."""
        self.armed = False
        everyone = tuple(self._roster.health)
        servos.sync_write(blocks.WATCHDOG_ADDRESS, dict.fromkeys(everyone, b"\0"))
        answers = servos.sync_read(blocks.WATCHDOG_ADDRESS, 1, self._roster.alive)
        still = [servo_id for servo_id, raw in answers.data.items() if raw != b"\0"]
        for servo_id in (*still, *answers.missing):
            self._impatiently(servos, partial(servos.write, servo_id, blocks.WATCHDOG_ADDRESS, b"\0"))

    def note_missing(self, servos: ServoLine, answers: Answers) -> None:
        """After a servo that is silent those behind it in the same read may not answer either: ask each alone."""
        if not answers.data:
            self._roster.silences += not answers.garbled
            self.silent += 1
            if self.silent == 1 or answers.garbled:
                return

        def asked_alone(servo_id: int) -> bool:
            return self._impatiently(servos, partial(servos.ping, servo_id))

        if self._roster.note_missing(answers.missing, asked_alone, someone=bool(answers.data)):
            self.silent = 0

    def _mind_watchdog(self, servos: ServoLine, health: ServoHealth, found: int) -> None:
        """A watchdog that is off was reset with all the RAM; one that has tripped is set anew."""
        if found == self._units or not self.armed:
            return
        health.rebooted |= self.was_powerless(health.servo_id, found)
        health.watchdog_trips += found == blocks.WATCHDOG_TRIPPED
        _worked(partial(self.arm, servos, health, found))

    def _read_climate(self, servos: ServoLine) -> None:
        at_s = self._clock()
        answers = servos.sync_read(blocks.CLIMATE_ADDRESS, blocks.CLIMATE_BYTES, self._roster.alive)
        for servo_id, raw in answers.data.items():
            health, climate = self._roster.health[servo_id], Climate.of(raw)
            health.note_tick(climate.tick, at_s)
            health.voltage_v, health.temperature_c = VOLTAGE_UNIT_V * climate.voltage, float(climate.temperature)

    def _ask_dead(self, servos: ServoLine) -> None:
        """One of the dead, in turn; who answers again is one of the arm's once more."""
        self._pinged_s = self._clock()
        dead = [health for health in self._roster.health.values() if not health.alive]
        if dead:
            self._impatiently(servos, partial(self._revive, servos, dead[self._polls % len(dead)]))

    def _revive(self, servos: ServoLine, health: ServoHealth) -> None:
        raw = servos.read(health.servo_id, blocks.HEALTH_ADDRESS, blocks.HEALTH_BYTES)
        self._roster.note({health.servo_id: raw})
        self._mind_watchdog(servos, health, Condition.of(raw).watchdog)
        health.alive, health.misses, health.tick = True, 0, None

    @staticmethod
    def _impatiently(servos: ServoLine, step: Callable[[], object]) -> bool:
        with servos.patience(PROBE_PATIENCE_S):
            return _worked(step)


def _worked(step: Callable[[], object]) -> bool:
    """Whether it did; what did not is seen by the next poll."""
    try:
        step()
    except (DeviceTimeout, DeviceFault):
        return False
    return True

"""Emulated Dynamixel servos on one bus, moving the twin's arm."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

from drivers.arm.control_tables import (
    ACCELERATION_UNIT_RAD_S2,
    BAUDS,
    MODELS,
    TICK_RAD,
    VELOCITY_UNIT_RAD_S,
    OperatingMode,
)
from drivers.arm.emulated_bus import Answer, ServoBus
from drivers.arm.emulated_servo import EmulatedServo, Sensed
from drivers.arm.joints import JointSettings, ServoSettings
from drivers.arm.values import ArmState
from drivers.emulation.bad_line import BadLine
from drivers.twin import commands as c
from drivers.twin.faults import Verb
from drivers.twin.machine import Twin

DEVICE = "arm"
WRONG_RAD = 0.05
WATCH_S = 0.001  # how late a watchdog is at most
LONGEST_WATCH_S = 0.1  # until a watchdog that has been set meanwhile is seen


def viperx300_joints(twin: Twin) -> tuple[JointSettings, ...]:
    """The servos of a ViperX-300 with six axes; shoulder and elbow have a second servo, mirrored."""
    kinds = ("XM540-W270",) * 5 + ("XM430-W350",)
    ids = ((1,), (2, 3), (4, 5), (6,), (7,), (8,))
    return tuple(
        JointSettings(
            joint.name,
            tuple(ServoSettings(servo_id, kind, reversed=k == 1) for k, servo_id in enumerate(of_joint)),
            joint.low_rad,
            joint.high_rad,
        )
        for joint, kind, of_joint in zip(twin.physics.geometry.joints, kinds, ids, strict=True)
    )


@dataclass(slots=True)
class _Place:
    """A servo and how it sits on its joint."""

    servo: EmulatedServo
    settings: ServoSettings

    @property
    def direction(self) -> int:
        return -self.settings.direction if self.servo.reversed else self.settings.direction

    def tick_of(self, encoder_rad: float) -> int:
        turned = self.direction * round(encoder_rad / TICK_RAD)
        return self.settings.zero_tick + turned + self.servo.get("homing_offset")

    def angle_of(self, tick: int) -> float:
        return self.direction * (tick - self.settings.zero_tick - self.servo.get("homing_offset")) * TICK_RAD


class DynamixelEmulator:
    """``joints`` says which servos there are and how they sit; ``cold``: torque is off, the arm lies in its cradle.

    ``host_baud`` tells the rate the host now uses (None: always the right one). ``servo(id)`` gives a servo to be
    switched off, rebooted or set otherwise by a test; ``add_twin_of`` puts a second one with the same id on the bus.
    """

    def __init__(
        self,
        twin: Twin,
        clock: Callable[[], float],
        joints: Sequence[JointSettings] | None = None,
        *,
        baud: int = 1_000_000,
        operating_mode: OperatingMode = OperatingMode.EXTENDED_POSITION,
        cold: bool = False,
        host_baud: Callable[[], int | None] = lambda: None,
    ) -> None:
        self._twin, self._clock = twin, clock
        self._line: BadLine | None = None
        self._frozen: ArmState | None = None
        self._sensed: tuple[float, tuple[Sensed, ...]] = (-math.inf, ())
        if cold:
            twin.apply(clock(), c.WorldCradle())
        self._places: list[_Place] = []
        for k, joint in enumerate(viperx300_joints(twin) if joints is None else joints):
            for settings in joint.servos:
                self._places.append(self._placed(k, settings, baud, operating_mode))
        self._torque = [self._joint_torque(k) for k in range(len(twin.physics.geometry.joints))]
        self._profiles = [(0.0, 0.0)] * len(self._torque)
        self._errors = [0] * len(self._torque)
        self._bus = ServoBus([place.servo for place in self._places], clock, self._refresh, self._settle, host_baud)

    def _placed(self, joint: int, settings: ServoSettings, baud: int, mode: OperatingMode) -> _Place:
        servo = EmulatedServo(settings.servo_id, MODELS[settings.model], joint, self._clock())
        servo.set("baud_rate", BAUDS.index(baud))
        servo.set("operating_mode", mode)
        servo.set("return_delay_time", 0)
        servo.set("torque_enable", self._twin.physics.servos.torque_on)
        place = _Place(servo, settings)
        servo.set("goal_position", place.tick_of(self._twin.joint_profiles(self._clock())[joint][0]))
        return place

    # --- the wire

    def connect(self, line: BadLine) -> None:
        self._line = line

    def receive(self, data: bytes) -> None:
        """Bytes from the host."""
        line = self._connected
        if not line.hears:
            self._bus.forget()
            return
        heard_s = self._clock()
        self._mind_watchdogs(heard_s)
        for answer in self._bus.hear(data, heard_s):
            self._say(line, answer, heard_s)

    def _say(self, line: BadLine, answer: Answer, heard_s: float) -> None:
        """A servo answers after its return delay, however long it takes to emulate it."""
        line.say(answer.data, answer.delay_s - (self._clock() - heard_s), answer.heard_bytes)

    async def serve(self) -> None:
        """The servos' watchdogs; to be run as long as the bus has power."""
        while True:
            now_s = self._clock()
            self._mind_watchdogs(now_s)
            next_s = min(place.servo.trips_at_s for place in self._places)
            await asyncio.sleep(min(max(next_s - now_s, 0.0) + WATCH_S, LONGEST_WATCH_S))

    def _mind_watchdogs(self, now_s: float) -> None:
        for place in self._places:
            if place.servo.trips_at_s < now_s:
                place.servo.trip()
                self._twin.apply(now_s, c.JointHold(place.servo.joint))

    @property
    def _connected(self) -> BadLine:
        if self._line is None:
            raise RuntimeError("connect the emulator to its line first")
        return self._line

    # --- for tests

    def servo(self, servo_id: int) -> EmulatedServo:
        return next(place.servo for place in self._places if place.servo.servo_id == servo_id)

    def reboot(self, servo_id: int) -> None:
        """A servo loses its power for a moment."""
        self.servo(servo_id).reboot(self._clock())
        self._settle()

    def add_twin_of(self, servo_id: int, model: str | None = None) -> None:
        """A second servo with the same id, on the same joint."""
        place = next(place for place in self._places if place.servo.servo_id == servo_id)
        settings = replace(place.settings, model=model or place.settings.model)
        mode = OperatingMode(place.servo.get("operating_mode"))
        self._places.append(self._placed(place.servo.joint, settings, place.servo.baud, mode))
        self._bus.servos.append(self._places[-1].servo)

    def exchange(self, servo_id: int, model: str) -> None:
        """Another model is in this servo's place."""
        for k, place in enumerate(self._places):
            if place.servo.servo_id == servo_id:
                mode = OperatingMode(place.servo.get("operating_mode"))
                settings = replace(place.settings, model=model)
                self._places[k] = self._placed(place.servo.joint, settings, place.servo.baud, mode)
                self._bus.servos[k] = self._places[k].servo

    # --- the machine

    def _refresh(self, servos: Iterable[EmulatedServo], now_s: float) -> None:
        """What the servos show at this moment. One look at the machine serves all of them."""
        self._take_errors(now_s)
        if self._sensed[0] != now_s:
            self._sensed = (now_s, self._look(now_s))
        for place, sensed in zip(self._places, self._sensed[1], strict=True):
            if place.servo in servos:
                place.servo.sense(now_s, sensed)

    def _look(self, now_s: float) -> tuple[Sensed, ...]:
        state, profiles = self._seen(self._twin.arm_state(now_s)), self._twin.joint_profiles(now_s)
        out = []
        for place in self._places:
            k, direction = place.servo.joint, place.direction
            profile_rad, profile_rad_s = profiles[k]
            out.append(
                Sensed(
                    effort=round(direction * state.load[k] * place.servo.model.effort_at_stall),
                    velocity=round(direction * state.velocity_rad_s[k] / VELOCITY_UNIT_RAD_S),
                    position=place.tick_of(state.position_rad[k]),
                    velocity_trajectory=round(direction * profile_rad_s / VELOCITY_UNIT_RAD_S),
                    position_trajectory=place.tick_of(profile_rad),
                    load=direction * state.load[k],
                )
            )
        return tuple(out)

    def _seen(self, state: ArmState) -> ArmState:
        """As a faulty sensor gives it."""
        verb = self._connected.verb
        if verb is Verb.STUCK:
            self._frozen = self._frozen or state
            return self._frozen
        self._frozen = None
        if verb is Verb.WRONG:
            first, *others = state.position_rad
            return replace(state, position_rad=(first + WRONG_RAD, *others))
        return state

    def _take_errors(self, now_s: float) -> None:
        """A joint's error shows at its first servo and takes the torque of all."""
        for joint, error in enumerate(self._twin.physics.servos.errors):
            if error == self._errors[joint]:
                continue
            self._errors[joint] = error
            of_joint = [place.servo for place in self._places if place.servo.joint == joint]
            of_joint[0].set("hardware_error_status", error)
            for servo in of_joint if error else ():
                servo.set("torque_enable", 0)
                servo.changed.add("torque_enable")
        self._settle()

    def _settle(self) -> None:
        """Let the machine follow what has been written."""
        now_s = self._clock()
        changed = [place for place in self._places if place.servo.changed]
        goals: dict[int, _Place] = {}
        for place in changed:
            servo, what = place.servo, place.servo.changed
            if "rebooted" in what:
                self._wake_up(place, now_s)
            torque_on = self._joint_torque(servo.joint)
            if self._torque[servo.joint] != torque_on:
                self._torque[servo.joint] = torque_on
                self._twin.apply(now_s, c.JointTorque(servo.joint, torque_on))
            if servo.torque_on and what & {"goal_position", "torque_enable"}:
                goals.setdefault(servo.joint, place)
            what.clear()
        if goals:
            self._move(goals, now_s)

    def _wake_up(self, place: _Place, now_s: float) -> None:
        """After a reboot the goal is the present place, and an error is forgotten."""
        joint = place.servo.joint
        place.servo.set("goal_position", place.tick_of(self._twin.arm_state(now_s).position_rad[joint]))
        if self._errors[joint]:
            self._errors[joint] = 0
            self._twin.apply(now_s, c.WorldServoError(joint, 0))

    def _move(self, goals: dict[int, _Place], now_s: float) -> None:
        """Goals under an acceleration profile are moves to rest, others may be of a stream."""
        streamed: dict[int, float] = {}
        for joint, place in goals.items():
            servo = place.servo
            profile = (
                servo.get("profile_velocity") * VELOCITY_UNIT_RAD_S,
                servo.get("profile_acceleration") * ACCELERATION_UNIT_RAD_S2,
            )
            if profile != self._profiles[joint]:
                self._profiles[joint] = profile
                self._twin.apply(now_s, c.JointProfile(joint, *profile))
            angle = place.angle_of(servo.get("goal_position"))
            if profile[1]:
                self._twin.apply(now_s, c.JointMove(joint, angle))
            else:
                streamed[joint] = angle
        if len(streamed) == len(self._torque):
            self._twin.apply(now_s, c.ArmGoal(tuple(streamed[joint] for joint in range(len(streamed)))))
        else:
            for joint, angle in streamed.items():
                self._twin.apply(now_s, c.JointGoal(joint, angle))

    def _joint_torque(self, joint: int) -> bool:
        return any(place.servo.torque_on for place in self._places if place.servo.joint == joint)

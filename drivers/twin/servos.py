"""Joint servos: goals in, angles out, with limits, lag, encoder noise and load."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from drivers.arm.values import ArmState
from drivers.twin.kinematics import ArmGeometry
from drivers.twin.servo import STEP_S, Servo

Array = npt.NDArray[np.float64]

ENCODER_TICK_RAD = math.tau / 4096
ENCODER_NOISE_RAD = 0.4 * ENCODER_TICK_RAD
LOAD_NOISE = 0.01
CRADLE_RAD = 0.02  # an arm this far from where its cradle bears it has left it
SAG_RAD_S_PER_N_M = 0.08
SAG_EVERY_STEPS = 10
GEAR_FRICTION_N_M = 0.2
REST_RAD = 1e-5
REST_RAD_S = 1e-4


class Servos:
    """The joints in position control, integrated on a fixed grid so that it never matters who looks when.

    Without torque a joint sinks slowly. ``frozen``: the joints are jammed. ``up`` (3,) is in the arm's root frame.
    """

    def __init__(
        self,
        geometry: ArmGeometry,
        start_rad: Sequence[float],
        velocity_rad_s: float,
        acceleration_rad_s2: float,
        zero_rad: Sequence[float],
        up: Array,
    ) -> None:
        if not len(geometry.joints) == len(start_rad) == len(zero_rad):
            raise ValueError(
                f"arm: expected {len(geometry.joints)} joint angles, found {len(start_rad)}; correct stow_rad"
            )
        self._geometry = geometry
        self._zero = tuple(zero_rad)
        self._up = up
        self._servos = [
            Servo(joint, start - zero, velocity_rad_s, acceleration_rad_s2)
            for joint, start, zero in zip(geometry.joints, start_rad, zero_rad, strict=True)
        ]
        self._stall_n_m = np.array([joint.effort_n_m for joint in geometry.joints])
        self._weighed_rad: Array = np.empty(0)
        self._weighed_n_m: Array = np.empty(0)
        self._cradle_rad: tuple[float, ...] | None = None
        self._steps = 0
        self.resting = True
        self.frozen = False

    @property
    def errors(self) -> tuple[int, ...]:
        """Each servo's error byte."""
        return tuple(servo.error for servo in self._servos)

    @property
    def torque_on(self) -> bool:
        """Whether every servo has torque."""
        return all(servo.torque_on for servo in self._servos)

    @property
    def profiles(self) -> tuple[tuple[float, float], ...]:
        """Encoder angle and speed of what each joint follows: its servo's profile, itself when limp."""
        return tuple(
            (servo.profile + zero, servo.profile_speed) for servo, zero in zip(self._servos, self._zero, strict=True)
        )

    @property
    def speeds_rad_s(self) -> tuple[float, ...]:
        """How fast each joint truly turns."""
        return tuple(servo.speed for servo in self._servos)

    def advance(self, t_s: float) -> float | None:
        """Integrate to ``t_s``; when the arm came to rest on the way, the moment it did."""
        steps = math.floor(t_s / STEP_S + 1e-9)
        rested_s = None
        while self._steps < steps and not self.resting:
            self._steps += 1
            if self._step(self._steps * STEP_S):
                rested_s = self._steps * STEP_S
        self._steps = max(self._steps, steps)
        return rested_s

    def goal(self, t_s: float, encoder_rad: Sequence[float]) -> bool:
        """A new goal in encoder angles, kept inside the joints' limits. True when the arm was at rest before."""
        for servo, angle, zero in zip(self._servos, encoder_rad, self._zero, strict=True):
            servo.set_goal(t_s, angle - zero)
        if self.resting and all(self._at_goal(servo) for servo in self._servos):
            return False
        return self._wake()

    def hold(self) -> None:
        """Brake as hard as the limit allows and keep the place where that ends."""
        for servo in self._servos:
            servo.stop_goal()
        self._wake()

    def torque(self, on: bool) -> None:
        """Torque on takes the present place as the goal."""
        for servo in self._servos:
            servo.set_torque(on)
        self._weigh()
        self._wake()

    def joint_goal(self, t_s: float, joint: int, encoder_rad: float) -> bool:
        """As ``goal``, for one joint."""
        servo = self._servos[joint]
        servo.set_goal(t_s, encoder_rad - self._zero[joint])
        return not (self.resting and self._at_goal(servo)) and self._wake()

    def joint_move(self, joint: int, encoder_rad: float) -> bool:
        """A goal to rest at, for one joint. True when the arm was at rest before."""
        servo = self._servos[joint]
        servo.move_to(encoder_rad - self._zero[joint])
        return not (self.resting and self._at_goal(servo)) and self._wake()

    def joint_hold(self, joint: int) -> None:
        """As ``hold``, for one joint."""
        self._servos[joint].stop_goal()
        self._wake()

    def joint_torque(self, joint: int, on: bool) -> None:
        """As ``torque``, for one joint."""
        self._servos[joint].set_torque(on)
        self._weigh()
        self._wake()

    def joint_profile(self, joint: int, velocity_rad_s: float, acceleration_rad_s2: float) -> None:
        """Limits of a servo below its own; 0 is none."""
        self._servos[joint].set_profile(velocity_rad_s, acceleration_rad_s2)

    def lie_in_cradle(self) -> None:
        """No torque, and a cradle that bears the arm where it is until it first leaves."""
        for servo in self._servos:
            servo.set_torque(False)
            servo.settle()
        self._cradle_rad = tuple(servo.angle for servo in self._servos)
        self._weigh()

    def servo_error(self, joint: int, error: int) -> None:
        """Show an error byte; any but 0 shuts that servo's torque off."""
        self._servos[joint].error = error
        self._weigh()
        self._wake()

    def freeze(self, frozen: bool) -> None:
        """Jam the joints, or free them: a freed arm goes on to its goal."""
        self.frozen = frozen
        self._wake()

    def angles_rad(self, t_s: float) -> Array:
        """True joint angles (n,)."""
        since_s = max(0.0, t_s - self._steps * STEP_S)
        return np.array([servo.angle + servo.speed * since_s for servo in self._servos])

    def reading(self, t_s: float, stamp_s: float, noise: np.random.Generator) -> ArmState:
        angles = self.angles_rad(t_s)
        n = len(angles)
        seen = angles + self._zero + noise.normal(0.0, ENCODER_NOISE_RAD, n)
        ticks = np.round(seen / ENCODER_TICK_RAD) * ENCODER_TICK_RAD
        load = -self._gravity_n_m(angles) / self._stall_n_m
        load = np.where([self._limp(servo) for servo in self._servos], 0.0, load) + noise.normal(0.0, LOAD_NOISE, n)
        return ArmState(
            stamp_s=stamp_s,
            position_rad=tuple(ticks.tolist()),
            velocity_rad_s=tuple(servo.speed for servo in self._servos),
            load=tuple(np.clip(load, -1.0, 1.0).tolist()),
            torque_on=self.torque_on,
            hardware_error=self.errors,
        )

    def _gravity_n_m(self, angles: Array) -> Array:
        """An arm at rest is asked often: the last answer is kept."""
        if not np.array_equal(angles, self._weighed_rad):
            self._weighed_rad, self._weighed_n_m = angles, self._geometry.gravity_torque_n_m(angles, self._up)
        return self._weighed_n_m

    def _wake(self) -> bool:
        was_resting, self.resting = self.resting, False
        return was_resting

    def _limp(self, servo: Servo) -> bool:
        return servo.error != 0 or not servo.torque_on

    def _at_goal(self, servo: Servo) -> bool:
        return self.frozen or self._limp(servo) or abs(servo.goal - servo.angle) < REST_RAD

    def _step(self, t_s: float) -> bool:
        """True when the arm has come to rest."""
        if self._steps % SAG_EVERY_STEPS == 0 and any(self._limp(servo) for servo in self._servos):
            self._weigh()
        for servo in self._servos:
            if self.frozen:
                servo.stay()
            elif servo.error != 0 or not servo.torque_on:
                servo.sink()
            else:
                servo.follow(t_s)
        if self._cradle_rad:
            self._leave_cradle(self._cradle_rad)
        for servo in self._servos:
            if abs(servo.speed) >= REST_RAD_S or not self._at_goal(servo):
                return False
        self.resting = True
        for servo in self._servos:
            servo.speed = 0.0
        return True

    def _leave_cradle(self, cradle: tuple[float, ...]) -> None:
        """An arm that has left its cradle is not borne by it again."""
        if any(abs(s.angle - rad) > CRADLE_RAD for s, rad in zip(self._servos, cradle, strict=True)):
            self._cradle_rad = None
            self._weigh()

    def _weigh(self) -> None:
        """What gravity makes of the limp joints, against the friction of their gears."""
        if self._cradle_rad is not None:
            for servo in self._servos:
                servo.sag_rad_s = 0.0
            return
        torque = self._geometry.gravity_torque_n_m([servo.angle for servo in self._servos], self._up)
        for servo, pull in zip(self._servos, torque.tolist(), strict=True):
            servo.sag_rad_s = math.copysign(max(abs(pull) - GEAR_FRICTION_N_M, 0.0), pull) * SAG_RAD_S_PER_N_M

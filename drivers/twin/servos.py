"""Joint servos: goals in, angles out, with limits, lag, encoder noise and load."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from drivers.arm.values import ArmState
from drivers.twin.kinematics import ArmGeometry, Joint

Array = npt.NDArray[np.float64]

STEP_S = 0.005
LAG_S = 0.040
ENCODER_TICK_RAD = math.tau / 4096
ENCODER_NOISE_RAD = 0.4 * ENCODER_TICK_RAD
LOAD_NOISE = 0.01
STREAM_GAP_S = 0.050  # goals farther apart than this are single moves, not a stream
CATCH_UP_SHARE = 0.04  # of the acceleration: a moving goal may itself brake nearly as hard as the servo can
OVERSHOOT_RAD = 0.002
SAG_RAD_S_PER_N_M = 0.08
SAG_EVERY_STEPS = 10
GEAR_FRICTION_N_M = 0.2
REST_RAD = 1e-5
REST_RAD_S = 1e-4

_LAG_SHARE = 1.0 - math.exp(-STEP_S / LAG_S)


class Servo:
    """One joint: a profile follows the goal within the limits, the joint lags the profile by a first order."""

    def __init__(self, joint: Joint, start_rad: float, velocity_rad_s: float, acceleration_rad_s2: float) -> None:
        self._low, self._high = joint.low_rad, joint.high_rad
        self._velocity, self._acceleration = velocity_rad_s, acceleration_rad_s2
        self._half_step = 0.5 * acceleration_rad_s2 * STEP_S
        self.angle = start_rad
        self.speed = 0.0
        self.goal = self.profile = start_rad
        self._mean_speed = 0.0
        self.goal_speed = self.goal_change = self.profile_speed = 0.0
        self.sag_rad_s = 0.0
        self.error = 0

    def set_goal(self, goal: float, gap_s: float) -> None:
        """``gap_s`` after the last goal; in a stream the goal is taken to move on as it has."""
        goal = self._clip(goal)
        in_stream = 0.0 < gap_s <= STREAM_GAP_S
        mean_speed = (goal - self.goal) / gap_s if in_stream else 0.0
        bound = self._acceleration
        change = min(max((mean_speed - self._mean_speed) / gap_s, -bound), bound) if in_stream else 0.0
        self._mean_speed, self.goal_change = mean_speed, change
        self.goal_speed = mean_speed + 0.5 * change * gap_s if in_stream else 0.0
        if self.goal_speed * mean_speed < 0.0:
            self.goal_speed = self.goal_change = 0.0
        self.goal = goal

    def stop_goal(self) -> None:
        """The goal is where the hardest braking ends."""
        self.goal, self.goal_speed, self.goal_change = self._stopping_rad(), 0.0, 0.0

    def end_stream(self) -> None:
        """The stream of goals has ceased: too fast to stop at the last one, stop beyond it and stay there."""
        if self.goal_speed == 0.0:
            return
        beyond = math.copysign(1.0, self.profile_speed) * (self._stopping_rad() - self.goal)
        if beyond > OVERSHOOT_RAD:
            self.goal = self._stopping_rad()
        self.goal_speed = self.goal_change = 0.0

    def settle(self) -> None:
        """Want to be where the joint is."""
        self.goal = self.profile = self.angle
        self.goal_speed = self.goal_change = self.profile_speed = 0.0

    def follow(self, since_s: float) -> None:
        """One step towards the goal as it is ``since_s`` after it was set."""
        half = self._half_step
        goal, goal_speed = self._goal_now(since_s) if self.goal_speed else (self.goal, 0.0)
        ahead = goal - self.profile
        distance = abs(ahead)
        spare = self._acceleration * (CATCH_UP_SHARE if self.goal_speed else 1.0)
        braking = math.sqrt(half * half + 2.0 * spare * distance) - half
        wanted = goal_speed + math.copysign(min(braking, distance / STEP_S), ahead)
        wanted = min(max(wanted, -self._velocity), self._velocity)
        self.profile_speed = min(max(wanted, self.profile_speed - 2.0 * half), self.profile_speed + 2.0 * half)
        self.profile += self.profile_speed * STEP_S
        self._move(self.angle + (self.profile - self.angle) * _LAG_SHARE)

    def _goal_now(self, since_s: float) -> tuple[float, float]:
        """Where a goal in a stream is by now, and how fast; one that brakes does not turn back."""
        if self.goal_speed * self.goal_change < 0.0:
            since_s = min(since_s, -self.goal_speed / self.goal_change)
        speed = self.goal_speed + self.goal_change * since_s
        return self.goal + 0.5 * (self.goal_speed + speed) * since_s, speed

    def sink(self) -> None:
        """One step without torque."""
        self._move(self.angle + self.sag_rad_s * STEP_S)
        self.settle()

    def stay(self) -> None:
        """One step jammed."""
        self._move(self.angle)
        self.profile, self.profile_speed = self.angle, 0.0

    def _move(self, angle: float) -> None:
        angle = self._clip(angle)
        self.speed, self.angle = (angle - self.angle) / STEP_S, angle

    def _stopping_rad(self) -> float:
        v = self.profile_speed
        return self._clip(self.profile + v * abs(v) / (2.0 * self._acceleration))

    def _clip(self, angle: float) -> float:
        return min(max(angle, self._low), self._high)


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
        self._weighed_rad: Array = np.empty(0)
        self._weighed_n_m: Array = np.empty(0)
        self._goal_at_s = -math.inf
        self._steps = 0
        self.resting = True
        self.torque_on = True
        self.frozen = False

    @property
    def errors(self) -> tuple[int, ...]:
        """Each servo's error byte."""
        return tuple(servo.error for servo in self._servos)

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
        gap_s = t_s - self._goal_at_s
        for servo, angle, zero in zip(self._servos, encoder_rad, self._zero, strict=True):
            servo.set_goal(angle - zero, gap_s)
        self._goal_at_s = t_s
        if self.resting and all(self._at_goal(servo) for servo in self._servos):
            return False
        return self._wake()

    def hold(self) -> None:
        """Brake as hard as the limit allows and keep the place where that ends."""
        self._goal_at_s = -math.inf
        for servo in self._servos:
            servo.stop_goal()
        self._wake()

    def torque(self, on: bool) -> None:
        """Torque on takes the present place as the goal."""
        if on and not self.torque_on:
            for servo in self._servos:
                servo.settle()
        self.torque_on = on
        self._weigh()
        self._wake()

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
        stall = np.array([joint.effort_n_m for joint in self._geometry.joints])
        load = -self._gravity_n_m(angles) / stall
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
        return servo.error != 0 or not self.torque_on

    def _at_goal(self, servo: Servo) -> bool:
        return self.frozen or self._limp(servo) or abs(servo.goal - servo.angle) < REST_RAD

    def _step(self, t_s: float) -> bool:
        """True when the arm has come to rest."""
        since_s = t_s - self._goal_at_s
        if since_s > STREAM_GAP_S:
            since_s = 0.0
            for servo in self._servos:
                servo.end_stream()
        if self._steps % SAG_EVERY_STEPS == 0 and any(self._limp(servo) for servo in self._servos):
            self._weigh()
        for servo in self._servos:
            if self.frozen:
                servo.stay()
            elif self._limp(servo):
                servo.sink()
            else:
                servo.follow(since_s)
        self.resting = all(abs(servo.speed) < REST_RAD_S and self._at_goal(servo) for servo in self._servos)
        if self.resting:
            for servo in self._servos:
                servo.speed = 0.0
        return self.resting

    def _weigh(self) -> None:
        """What gravity makes of the limp joints, against the friction of their gears."""
        torque = self._geometry.gravity_torque_n_m([servo.angle for servo in self._servos], self._up)
        for servo, pull in zip(self._servos, torque.tolist(), strict=True):
            servo.sag_rad_s = math.copysign(max(abs(pull) - GEAR_FRICTION_N_M, 0.0), pull) * SAG_RAD_S_PER_N_M

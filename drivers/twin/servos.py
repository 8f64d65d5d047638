"""Joint servos: goals in, angles out, with limits, lag, encoder noise and load."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from drivers.arm.values import ArmState
from drivers.twin.kinematics import ArmGeometry

Array = npt.NDArray[np.float64]

STEP_S = 0.005
LAG_S = 0.040
ENCODER_TICK_RAD = math.tau / 4096
ENCODER_NOISE_RAD = 0.4 * ENCODER_TICK_RAD
LOAD_NOISE = 0.01
STREAM_GAP_S = 0.050  # goals farther apart than this are single moves, not a stream
SAG_RAD_S_PER_N_M = 0.08
SAG_EVERY_STEPS = 10
GEAR_FRICTION_N_M = 0.2
OVERSHOOT_RAD = 0.002
REST_RAD = 1e-5
REST_RAD_S = 1e-4


class Servos:
    """Six servos in position control, integrated on a fixed grid so that it never matters who looks when.

    A profile follows the goal within velocity and acceleration limits, feeding a stream's own velocity forward; the
    joint lags the profile by a first order. Without torque a joint sinks slowly. ``frozen``: the joints are jammed.
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
        self._geometry = geometry
        self._velocity, self._acceleration = velocity_rad_s, acceleration_rad_s2
        self._zero = np.asarray(zero_rad, dtype=np.float64)
        self._up = up
        self._low = np.array([joint.low_rad for joint in geometry.joints])
        self._high = np.array([joint.high_rad for joint in geometry.joints])
        self._joint = np.asarray(start_rad, dtype=np.float64) - self._zero  # true angles
        self._speed = np.zeros_like(self._joint)
        self._profile = self._joint.copy()
        self._profile_speed = np.zeros_like(self._joint)
        self._goal = self._joint.copy()
        self._goal_speed = np.zeros_like(self._joint)
        self._goal_at_s = -math.inf
        self._sag = np.zeros(0)
        self._steps = 0
        self._resting = True
        self.torque_on = True
        self.frozen = False
        self.errors = [0] * len(self._joint)

    @property
    def resting(self) -> bool:
        return self._resting

    def advance(self, t_s: float) -> float | None:
        """Integrate to ``t_s``; when the arm came to rest on the way and still rests, the moment it did."""
        steps = math.floor(t_s / STEP_S + 1e-9)
        rested_s = None
        while self._steps < steps and not self._resting:
            self._steps += 1
            if self._step(self._steps * STEP_S):
                rested_s = self._steps * STEP_S
        self._steps = max(self._steps, steps)
        return rested_s

    def goal(self, t_s: float, encoder_rad: Sequence[float]) -> bool:
        """A new goal in encoder angles, kept inside the joints' limits. True when the arm was at rest before."""
        goal = np.clip(np.asarray(encoder_rad, dtype=np.float64) - self._zero, self._low, self._high)
        if self._resting and np.abs(goal - self._joint).max() < REST_RAD:
            self._goal, self._goal_at_s = goal, t_s
            return False
        gap_s = t_s - self._goal_at_s
        streamed = 0.0 < gap_s <= STREAM_GAP_S
        self._goal_speed = (goal - self._goal) / gap_s if streamed else np.zeros_like(goal)
        self._goal, self._goal_at_s = goal, t_s
        return self._wake()

    def hold(self) -> None:
        """Brake as hard as the limit allows and keep the place where that ends."""
        self._goal = self._stopping_rad()
        self._goal_at_s = -math.inf
        self._goal_speed = np.zeros_like(self._goal)
        self._wake()

    def torque(self, on: bool) -> None:
        """Torque on takes the present place as the goal."""
        if on and not self.torque_on:
            self._goal, self._profile = self._joint.copy(), self._joint.copy()
            self._profile_speed, self._goal_speed = np.zeros_like(self._joint), np.zeros_like(self._joint)
        self.torque_on = on
        self._wake()

    def servo_error(self, joint: int, error: int) -> None:
        """Show an error byte; any but 0 shuts that servo's torque off."""
        self.errors[joint] = error
        self._wake()

    def freeze(self, frozen: bool) -> None:
        """Jam the joints, or free them: a freed arm goes on to its goal."""
        self.frozen = frozen
        self._wake()

    def angles_rad(self, t_s: float) -> Array:
        """True joint angles (n,)."""
        return self._joint + self._speed * max(0.0, t_s - self._steps * STEP_S)

    def encoder_rad(self) -> Array:
        """What noiseless encoders of infinite resolution would read (n,)."""
        return self._joint + self._zero

    def reading(self, t_s: float, stamp_s: float, noise: np.random.Generator) -> ArmState:
        n = len(self._joint)
        angles = self.angles_rad(t_s) + self._zero + noise.normal(0.0, ENCODER_NOISE_RAD, n)
        ticks = np.round(angles / ENCODER_TICK_RAD) * ENCODER_TICK_RAD
        effort = np.array([joint.effort_n_m for joint in self._geometry.joints])
        holding = -self._geometry.gravity_torque_n_m(self._joint, self._up) / effort
        load = (holding if self.torque_on else np.zeros(n)) + noise.normal(0.0, LOAD_NOISE, n)
        return ArmState(
            stamp_s=stamp_s,
            position_rad=tuple(ticks.tolist()),
            velocity_rad_s=tuple(self._speed.tolist()),
            load=tuple(np.clip(load, -1.0, 1.0).tolist()),
            torque_on=self.torque_on,
            hardware_error=tuple(self.errors),
        )

    def _wake(self) -> bool:
        was_resting, self._resting = self._resting, False
        return was_resting

    def _step(self, t_s: float) -> bool:
        """True when the arm has come to rest."""
        before = self._joint
        limp = np.array([error != 0 or not self.torque_on for error in self.errors])
        if self.frozen:
            self._profile, self._profile_speed = before.copy(), np.zeros_like(before)
        else:
            self._follow(t_s)
            if limp.any():
                self._sink(limp, before)
            self._joint = np.clip(self._joint, self._low, self._high)
        self._speed = (self._joint - before) / STEP_S
        away = np.where(limp | self.frozen, 0.0, self._goal - self._joint)
        self._resting = bool(np.abs(self._speed).max() < REST_RAD_S and np.abs(away).max() < REST_RAD)
        if self._resting:
            self._speed = np.zeros_like(before)
        return self._resting

    def _follow(self, t_s: float) -> None:
        """One step of the profile towards the goal (moving on with its stream), and of the joint after the profile."""
        since_s = t_s - self._goal_at_s
        if since_s > STREAM_GAP_S:
            self._end_stream()
            since_s = 0.0
        ahead = self._goal + self._goal_speed * since_s - self._profile
        distance = np.abs(ahead)
        half = 0.5 * self._acceleration * STEP_S
        braking = np.sqrt(half * half + 2.0 * self._acceleration * distance) - half
        wanted = self._goal_speed + np.sign(ahead) * np.minimum(braking, distance / STEP_S)
        wanted = np.clip(wanted, -self._velocity, self._velocity)
        self._profile_speed = np.clip(wanted, self._profile_speed - 2 * half, self._profile_speed + 2 * half)
        self._profile = self._profile + self._profile_speed * STEP_S
        self._joint = self._joint + (self._profile - self._joint) * (1.0 - math.exp(-STEP_S / LAG_S))

    def _end_stream(self) -> None:
        """The stream of goals has ceased: a joint too fast to stop at its last goal stops beyond it and stays."""
        if not self._goal_speed.any():
            return
        self._goal_speed = np.zeros_like(self._goal_speed)
        beyond = (self._stopping_rad() - self._goal) * np.sign(self._profile_speed)
        self._goal = np.where(beyond > OVERSHOOT_RAD, self._stopping_rad(), self._goal)

    def _stopping_rad(self) -> Array:
        speed = self._profile_speed
        stopping = self._profile + speed * np.abs(speed) / (2.0 * self._acceleration)
        return np.clip(stopping, self._low, self._high)

    def _sink(self, limp: npt.NDArray[np.bool_], before: Array) -> None:
        """Joints without torque give way to gravity, against the friction of their gears."""
        if self._steps % SAG_EVERY_STEPS == 0 or self._sag.shape != before.shape:
            torque = self._geometry.gravity_torque_n_m(before, self._up)
            self._sag = SAG_RAD_S_PER_N_M * np.sign(torque) * np.maximum(np.abs(torque) - GEAR_FRICTION_N_M, 0.0)
        sunk = np.clip(before + self._sag * STEP_S, self._low, self._high)
        self._joint = np.where(limp, sunk, self._joint)
        self._profile = np.where(limp, sunk, self._profile)
        self._goal = np.where(limp, sunk, self._goal)
        self._profile_speed = np.where(limp, 0.0, self._profile_speed)

"""A differential drive: speeds in, motion with slip out, counters that never forget."""

from __future__ import annotations

import math

import numpy as np

from drivers.twin.deviations import TrueMachine
from drivers.twin.nominal import Nominal
from drivers.wheels.values import Odometry

STEP_S = 0.005
BRAKE_FACTOR = 2.0
COUNTS_A_TURN = 4096
COUNT_NOISE = 0.5
SPEED_NOISE_M_S = 0.001
SLIP_MEAN = 0.002
SLIP_SIGMA = 0.002
SLIP_UNEVEN_SIGMA = 0.0003
SLIP_BUCKET_M = 0.2


class Drive:
    """The base on the ground, integrated on a fixed grid while it moves.

    Commands are speeds by the nominal wheel; without a new one for the time-out the controller brakes. ``frozen``: the
    controller keeps its present speeds, deaf to commands and time-out. ``pose`` is x, y, heading in the row frame.
    """

    def __init__(self, nominal: Nominal, true: TrueMachine, seed: int) -> None:
        self._nominal_radius_m = nominal.wheel_radius_m
        self._radius_m = true.wheel_radius_m
        self._track_m = nominal.track_m
        self._max_speed_m_s = nominal.max_speed_m_s
        self._acceleration = nominal.max_acceleration_m_s2
        self._ramps = (nominal.max_acceleration_m_s2, nominal.max_acceleration_m_s2)  # up and down
        self._timeout_s = nominal.drive_timeout_s
        self._seed = seed
        self._pose = (0.0, 0.0, 0.0)
        self._wanted = (0.0, 0.0)
        self._speed = [0.0, 0.0]  # as the controller counts it
        self._rolled_m = [0.0, 0.0]
        self._commanded_s = 0.0
        self._brake = False
        self._steps = 0
        self._slips: dict[int, tuple[float, float]] = {}
        self.powered = True
        self.frozen = False

    @property
    def resting(self) -> bool:
        return self._speed == [0.0, 0.0] and (self._wanted == (0.0, 0.0) or not self.powered or self.frozen)

    @property
    def pose(self) -> tuple[float, float, float]:
        return self._pose

    @property
    def counters_m(self) -> tuple[float, float]:
        return self._rolled_m[0], self._rolled_m[1]

    @property
    def speeds_m_s(self) -> tuple[float, float]:
        """Forward speed and rate of turn (rad/s) as the controller counts them."""
        left, right = self._speed
        return 0.5 * (left + right), (right - left) / self._track_m

    def command(self, t_s: float, speed_m_s: float, yaw_rate_rad_s: float) -> bool:
        """Speeds, scaled down together to what the wheels can; True when they differ from those before."""
        turn = 0.5 * yaw_rate_rad_s * self._track_m
        left, right = speed_m_s - turn, speed_m_s + turn
        scale = min(1.0, self._max_speed_m_s / max(abs(left), abs(right), 1e-9))
        wanted = (left * scale, right * scale)
        changed = wanted != self._wanted
        self._wanted, self._commanded_s, self._brake = wanted, t_s, False
        return changed

    def stop(self, t_s: float) -> bool:
        """Brake; True when the base was to move."""
        changed = self._wanted != (0.0, 0.0)
        self._wanted, self._commanded_s, self._brake = (0.0, 0.0), t_s, True
        return changed

    def set_ramps(self, acceleration_m_s2: float, deceleration_m_s2: float, timeout_s: float) -> None:
        """What the controller keeps to from now on; how hard it brakes in a stop is not its setting."""
        self._ramps, self._timeout_s = (acceleration_m_s2, deceleration_m_s2), timeout_s

    def push(self, x_m: float, y_m: float, heading_rad: float) -> None:
        """Shift the base in its own axes; the wheels skid."""
        x, y, heading = self._pose
        c, s = math.cos(heading), math.sin(heading)
        self._pose = (x + c * x_m - s * y_m, y + s * x_m + c * y_m, heading + heading_rad)

    def advance(self, t_s: float) -> float | None:
        """Integrate to ``t_s``; when the base came to rest on the way, the moment it did."""
        steps = math.floor(t_s / STEP_S + 1e-9)
        rested_s = None
        while self._steps < steps and not self.resting:
            self._steps += 1
            if self._step(self._steps * STEP_S):
                rested_s = self._steps * STEP_S
        self._steps = max(self._steps, steps)
        return rested_s

    def reading(self, stamp_s: float, noise: np.random.Generator) -> Odometry:
        count_m = math.tau * self._nominal_radius_m / COUNTS_A_TURN
        jitter, speed = noise.normal(0.0, COUNT_NOISE, 2), noise.normal(0.0, SPEED_NOISE_M_S, 2)
        if self._speed == [0.0, 0.0]:
            jitter, speed = np.zeros(2), np.zeros(2)
        left, right = (round(m / count_m + j) * count_m for m, j in zip(self._rolled_m, jitter, strict=True))
        return Odometry(
            stamp_s=stamp_s,
            left_m=left,
            right_m=right,
            left_m_s=self._speed[0] + float(speed[0]),
            right_m_s=self._speed[1] + float(speed[1]),
        )

    def _step(self, t_s: float) -> bool:
        """True when the base has come to rest."""
        wanted, brake = self._wanted, self._brake
        if self.frozen and self.powered:
            wanted = (self._speed[0], self._speed[1])
        elif not self.powered or t_s - self._commanded_s > self._timeout_s:
            wanted, brake = (0.0, 0.0), True
            self._wanted, self._brake = wanted, brake
        slips = self._slip()
        ground = [0.0, 0.0]
        for k in (0, 1):
            before = self._speed[k]
            change = self._change(before, wanted[k], brake)
            after = min(max(wanted[k], before - change), before + change)
            rolled = 0.5 * (before + after) * STEP_S
            self._speed[k] = after
            self._rolled_m[k] += rolled
            ground[k] = rolled * self._radius_m[k] / self._nominal_radius_m * (1.0 - slips[k])
        self._move(0.5 * (ground[0] + ground[1]), (ground[1] - ground[0]) / self._track_m)
        return self.resting

    def _change(self, speed: float, wanted: float, brake: bool) -> float:
        """The most by which a wheel's speed changes in a step."""
        if brake:
            return self._acceleration * STEP_S * BRAKE_FACTOR
        up, down = self._ramps
        return (down if abs(wanted) < abs(speed) or wanted * speed < 0.0 else up) * STEP_S

    def _move(self, forward_m: float, turn_rad: float) -> None:
        """Along the arc's chord."""
        x, y, heading = self._pose
        middle = heading + 0.5 * turn_rad
        self._pose = (x + forward_m * math.cos(middle), y + forward_m * math.sin(middle), heading + turn_rad)

    def _slip(self) -> tuple[float, float]:
        """Slip of either wheel, a property of the ground: the same seed slips alike at the same distance."""
        bucket = math.floor(0.5 * (self._rolled_m[0] + self._rolled_m[1]) / SLIP_BUCKET_M)
        if bucket not in self._slips:
            rng = np.random.default_rng([self._seed, 0x511B, bucket + 2**31])
            both = max(0.0, rng.normal(SLIP_MEAN, SLIP_SIGMA))
            uneven = rng.normal(0.0, SLIP_UNEVEN_SIGMA)
            self._slips[bucket] = (both - 0.5 * uneven, both + 0.5 * uneven)
        return self._slips[bucket]

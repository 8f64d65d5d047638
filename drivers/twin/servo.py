"""One joint under position control: a profile follows the goal within the limits, the joint lags the profile."""

from __future__ import annotations

import math

from drivers.twin.kinematics import Joint

STEP_S = 0.005
LAG_S = 0.040
STREAM_GAP_S = 0.050  # goals farther apart than this are single moves, not a stream
CATCH_UP_SHARE = 0.04  # of the acceleration: a moving goal may itself brake nearly as hard as the servo can
OVERSHOOT_RAD = 0.002

_LAG_SHARE = 1.0 - math.exp(-STEP_S / LAG_S)


class Servo:
    """``start_rad`` and goals are true joint angles; the joint lags its profile by a first order."""

    def __init__(self, joint: Joint, start_rad: float, velocity_rad_s: float, acceleration_rad_s2: float) -> None:
        self._low, self._high = joint.low_rad, joint.high_rad
        self._bounds = (velocity_rad_s, acceleration_rad_s2)
        self._velocity, self._acceleration = self._bounds
        self._half_step = 0.5 * acceleration_rad_s2 * STEP_S
        self.goal_at_s = -math.inf
        self.torque_on = True
        self.angle = start_rad
        self.speed = 0.0
        self.goal = self.profile = start_rad
        self._mean_speed = 0.0
        self.goal_speed = self.goal_change = self.profile_speed = 0.0
        self.sag_rad_s = 0.0
        self.error = 0

    def set_profile(self, velocity_rad_s: float, acceleration_rad_s2: float) -> None:
        """Limits below those of the servo itself; 0 is none."""
        velocity, acceleration = self._bounds
        self._velocity = min(velocity, velocity_rad_s or velocity)
        self._acceleration = min(acceleration, acceleration_rad_s2 or acceleration)
        self._half_step = 0.5 * self._acceleration * STEP_S

    def set_goal(self, t_s: float, goal: float) -> None:
        """Soon after the last goal it is one of a stream, and the goal is taken to move on as it has."""
        gap_s, self.goal_at_s = t_s - self.goal_at_s, t_s
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

    def move_to(self, goal: float) -> None:
        """A goal to rest at."""
        self.goal_at_s = -math.inf
        self.goal, self.goal_speed, self.goal_change = self._clip(goal), 0.0, 0.0

    def stop_goal(self) -> None:
        """The goal is where the hardest braking ends."""
        self.move_to(self._stopping_rad())

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

    def set_torque(self, on: bool) -> None:
        """Torque on takes the present place as the goal."""
        if on and not self.torque_on:
            self.settle()
        self.torque_on = on

    def follow(self, t_s: float) -> None:
        """One step towards the goal as it is by ``t_s``. Called a thousand times a second of an arm's motion."""
        since_s = t_s - self.goal_at_s
        if since_s > STREAM_GAP_S:
            since_s = 0.0
            self.end_stream()
        half, velocity, profile = self._half_step, self._velocity, self.profile
        if self.goal_speed:
            goal, goal_speed = self._goal_now(since_s)
            spare = self._acceleration * CATCH_UP_SHARE
        else:
            goal, goal_speed, spare = self.goal, 0.0, self._acceleration
        ahead = goal - profile
        distance = abs(ahead)
        braking = math.sqrt(half * half + 2.0 * spare * distance) - half
        at_once = distance / STEP_S
        wanted = goal_speed + math.copysign(braking if braking < at_once else at_once, ahead)
        wanted = -velocity if wanted < -velocity else velocity if wanted > velocity else wanted
        slowest, fastest = self.profile_speed - 2.0 * half, self.profile_speed + 2.0 * half
        speed = slowest if wanted < slowest else fastest if wanted > fastest else wanted
        self.profile_speed = speed
        self.profile = profile = profile + speed * STEP_S
        before = self.angle
        angle = before + (profile - before) * _LAG_SHARE
        angle = self._low if angle < self._low else self._high if angle > self._high else angle
        self.speed, self.angle = (angle - before) / STEP_S, angle

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

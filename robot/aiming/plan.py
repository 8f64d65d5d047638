"""One fruit -> a nozzle pose and a collision-free trajectory to it, or the reason why not."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from drivers.arm.values import JointTrajectory
from robot.aiming.approach import spray_axes, spray_caught_by_others, spray_gap_to_body_m
from robot.aiming.capsules import Sphere
from robot.aiming.collision import CollisionModel, Thing
from robot.aiming.inverse import inverse_kinematics
from robot.aiming.kinematics import joint_reach_m
from robot.aiming.obstacles import Obstacles
from robot.aiming.parameters import AimingParameters
from robot.aiming.path import Roads
from robot.aiming.stand_off import stand_offs_m
from robot.aiming.trajectory import MotionLimits, joint_trajectory, travel_time_s
from robot.aiming.urdf import ArmModel
from robot.aiming.values import AimPlan, Unreachable, WhyUnreachable
from robot.geometry import Vector

_ANGLE_COST_S_PER_RAD = 4.0
_CAUGHT_COST_S = 4.0
_SHORT_COST_S = 1.5
_AXIS_COVERED = 0.5  # another fruit reaches to the middle of the cone: more of the dose would be its than the target's
_TIGHT_COST_S_PER_M = 20.0
_CHECKED_AT_ONCE = 48
_GOALS_WHEN_BLOCKED = 128


@dataclass(frozen=True, slots=True, eq=False)
class _Goals:
    """Candidate postures, best first: joints (m, n), nozzle (m, 3), axis (m, 3), stand-off (m,), and what each costs
    (m,) beside the travel there: seconds that one would travel longer to avoid it."""

    joints_rad: Vector
    nozzle_m: Vector
    axis: Vector
    stand_off_m: Vector
    cost_s: Vector

    def some(self, which: npt.NDArray[np.int64]) -> _Goals:
        return _Goals(
            self.joints_rad[which], self.nozzle_m[which], self.axis[which], self.stand_off_m[which], self.cost_s[which]
        )


def motion_limits(model: ArmModel, parameters: AimingParameters) -> MotionLimits:
    """What trajectories may use: ``limit_fraction`` of the configured limits, and of the URDF's speeds."""
    velocity = np.minimum(model.velocity_rad_s, parameters.max_velocity_rad_s) * parameters.limit_fraction
    acceleration = np.full_like(velocity, parameters.max_acceleration_rad_s2 * parameters.limit_fraction)
    return MotionLimits(velocity, acceleration)


def plan(
    fruit_centre_m: Vector,
    diameter_m: float,
    joints_rad: Vector,
    model: ArmModel,
    parameters: AimingParameters,
    obstacles: Obstacles,
) -> AimPlan | Unreachable:
    """Aim at the fruit at ``fruit_centre_m`` (3,) from the present angles ``joints_rad`` (n,), never across the rover.

    Everything in the arm's base frame. ``obstacles.fruits`` may hold the target itself: a ball whose centre lies
    inside the target's inner half is taken for it. Raises ``ValueError`` on numbers that are not finite.
    """
    centre = _finite("fruit_centre_m", fruit_centre_m, 3)
    start = _finite("joints_rad", joints_rad, len(model.joints))
    others = tuple(
        ball for ball in obstacles.fruits if float(np.linalg.norm(ball.centre_m - centre)) > diameter_m / 4
    )
    scene = Obstacles(obstacles.body, obstacles.supports, (*others, Sphere(centre, diameter_m / 2)))
    goals = _goals(centre, diameter_m, start, model, parameters, scene)
    if isinstance(goals, Unreachable):
        return goals
    collisions = CollisionModel(model, scene, parameters.collision_margin_m)
    limits = motion_limits(model, parameters)
    roads = Roads(collisions, parameters, limits)
    clear = _clear_goals(goals, collisions, parameters.goals_tried)
    found = roads.straight(start, clear.joints_rad, clear.cost_s)
    if found is None:
        clear = _clear_goals(goals, collisions, _GOALS_WHEN_BLOCKED)
        if not len(clear.cost_s):
            return Unreachable(_what_is_in_the_way(goals, collisions))
        clear = _spread_out(clear, parameters.goals_tried)
        found = roads.by_vias(start, clear.joints_rad, clear.cost_s)
    if found is None:
        return Unreachable(WhyUnreachable.NO_PATH)
    way, k = found
    trajectory = joint_trajectory(way, limits, parameters.sample_s)
    return AimPlan(clear.nozzle_m[k], clear.axis[k], float(clear.stand_off_m[k]), trajectory.goal_rad, trajectory)


def plan_joints(
    joints_rad: Vector, goal_rad: Vector, model: ArmModel, parameters: AimingParameters, obstacles: Obstacles
) -> JointTrajectory | Unreachable:
    """A collision-free trajectory between two sets of joint angles (n,), as for stowing and unfolding."""
    start = _finite("joints_rad", joints_rad, len(model.joints))
    goal = _finite("goal_rad", goal_rad, len(model.joints))
    if ((goal < model.lower_rad - 1e-9) | (goal > model.upper_rad + 1e-9)).any():
        return Unreachable(WhyUnreachable.JOINT_LIMITS)
    collisions = CollisionModel(model, obstacles, parameters.collision_margin_m)
    limits = motion_limits(model, parameters)
    touched = collisions.touched(goal)
    if touched & {Thing.ARM, Thing.ROVER}:
        return Unreachable(WhyUnreachable.SELF_COLLISION)
    if touched:
        return Unreachable(WhyUnreachable.PLANT_COLLISION)
    roads = Roads(collisions, parameters, limits)
    found = roads.straight(start, goal[None], np.zeros(1)) or roads.by_vias(start, goal[None], np.zeros(1))
    if found is None:
        return Unreachable(WhyUnreachable.NO_PATH)
    return joint_trajectory(found[0], limits, parameters.sample_s)


def _clear_goals(goals: _Goals, collisions: CollisionModel, wanted: int) -> _Goals:
    """The first ``wanted`` goals that keep the margin; those that keep less than twice the margin cost more."""
    clear: list[int] = []
    tight_m: list[float] = []
    for first in range(0, len(goals.cost_s), _CHECKED_AT_ONCE):
        least_m = collisions.clearances(goals.joints_rad[first : first + _CHECKED_AT_ONCE]).least_m()
        for k in np.flatnonzero(least_m >= collisions.margin_m):
            clear.append(first + int(k))
            tight_m.append(max(0.0, 2.0 * collisions.margin_m - float(least_m[k])))
        if len(clear) >= wanted:
            break
    some = goals.some(np.array(clear, dtype=np.int64))
    return replace(some, cost_s=some.cost_s + _TIGHT_COST_S_PER_M * np.array(tight_m))


def _spread_out(goals: _Goals, count: int) -> _Goals:
    """The best quarter of ``count`` goals and others evenly from all, so that they differ."""
    best = np.arange(min(len(goals.cost_s), count // 4))
    others = np.linspace(0, len(goals.cost_s) - 1, count - best.size).astype(np.int64)
    return goals.some(np.unique(np.concatenate([best, others])))


def _what_is_in_the_way(goals: _Goals, collisions: CollisionModel) -> WhyUnreachable:
    clearances = collisions.clearances(goals.joints_rad)
    near = (clearances.gap_m < collisions.margin_m) & np.isin(clearances.thing, (Thing.SUPPORT, Thing.FRUIT))
    return WhyUnreachable.PLANT_COLLISION if near.any() else WhyUnreachable.SELF_COLLISION


def _goals(
    centre: Vector,
    diameter_m: float,
    start: Vector,
    model: ArmModel,
    parameters: AimingParameters,
    scene: Obstacles,
) -> _Goals | Unreachable:
    """All postures that aim at the fruit without spraying the rover, whether clear or not. The target is the last of
    the scene's fruit."""
    distances = np.array(stand_offs_m(diameter_m, parameters))
    seen_along = centre - np.array(parameters.camera_m)
    fan = spray_axes(seen_along, parameters.fan_half_angle_rad, parameters.fan_directions)
    axis = np.tile(fan, (len(distances), 1))
    stand_off = np.repeat(distances, len(fan))
    nozzle = centre - stand_off[:, None] * axis
    off_angle = np.tile(np.arccos(np.clip(fan @ fan[0], -1.0, 1.0)), len(distances))
    spray_radius = stand_off * math.tan(parameters.cone_half_angle_rad)
    dry = spray_gap_to_body_m(nozzle, centre, spray_radius, scene.body) > 0.0
    if not dry.any():
        return Unreachable(WhyUnreachable.SELF_COLLISION)
    axis, stand_off, nozzle, off_angle = axis[dry], stand_off[dry], nozzle[dry], off_angle[dry]
    seed = np.clip(start, model.lower_rad, model.upper_rad)
    solutions = inverse_kinematics(model, nozzle, axis, seed)
    pose, branch = np.nonzero(solutions.valid)
    if not pose.size:
        return Unreachable(_why_no_angles(model, nozzle, bool(solutions.in_reach.any())))
    caught = spray_caught_by_others(nozzle, axis, stand_off, parameters.cone_half_angle_rad, scene.fruits[:-1])
    free = caught[pose] <= _AXIS_COVERED
    if not free.any():
        return Unreachable(WhyUnreachable.HIDDEN)
    pose, branch = pose[free], branch[free]
    joints = solutions.joints_rad[pose, branch]
    pose_cost = (
        _ANGLE_COST_S_PER_RAD * off_angle
        + _CAUGHT_COST_S * caught
        + _SHORT_COST_S * (1.0 - stand_off / distances[0])
    )
    cost = pose_cost[pose] + travel_time_s(joints - start, motion_limits(model, parameters))
    order = np.argsort(cost, kind="stable")
    pose = pose[order]
    return _Goals(joints[order], nozzle[pose], axis[pose], stand_off[pose], pose_cost[pose])


def _why_no_angles(model: ArmModel, nozzle_m: Vector, in_reach: bool) -> WhyUnreachable:
    if in_reach:
        return WhyUnreachable.JOINT_LIMITS
    from_waist_m = np.linalg.norm(nozzle_m - model.joints[0].parent_from_joint.translation_m, axis=1)
    far = float(np.median(from_waist_m)) > 0.5 * float(joint_reach_m(model)[0])
    return WhyUnreachable.TOO_FAR if far else WhyUnreachable.TOO_NEAR


def _finite(name: str, values: Vector, count: int) -> Vector:
    array = np.asarray(values, dtype=np.float64)
    if array.shape != (count,) or not np.isfinite(array).all():
        raise ValueError(f"{name}: expected {count} finite numbers, found {array.tolist()}")
    return array

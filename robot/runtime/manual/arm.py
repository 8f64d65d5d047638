"""Moving the arm by hand: one joint, the nozzle, or home, each a checked way that starts where the arm is."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from drivers.arm.values import JointTrajectory
from drivers.errors import DeviceError
from robot.actuation import Refused
from robot.aiming import ArmModel, Unreachable, inverse_kinematics, link_frames, nearest_solution, plan_joints
from robot.clock import work
from robot.errors import UsageError
from robot.geometry import Vector
from robot.runtime.manual.session import ByHand

LONGEST_STEP_RAD = 1.0
LONGEST_STEP_M = 0.3
STRAIGHT_RAD = 1e-6


def check_joint_step(model: ArmModel, name: str, by_rad: float) -> int:
    """The joint's place in the arm. ``UsageError`` for a joint or a step that cannot be meant."""
    if name not in model.joint_names:
        raise UsageError(f"there is no joint '{name}'; the arm has: {', '.join(model.joint_names)}")
    if not (math.isfinite(by_rad) and abs(by_rad) <= LONGEST_STEP_RAD):
        raise UsageError(f"{name} by {by_rad:g} rad: expected a step of at most {LONGEST_STEP_RAD:g} rad; go in steps")
    return model.joint_names.index(name)


def check_nozzle_step(by_m: tuple[float, float, float]) -> None:
    length_m = math.hypot(*by_m)
    if not (math.isfinite(length_m) and length_m <= LONGEST_STEP_M):
        raise UsageError(
            f"the nozzle by {_numbers(by_m)} m: expected a step of at most {LONGEST_STEP_M:g} m; go in steps"
        )


async def jog_joint(hands: ByHand, name: str, by_rad: float, speed_rad_s: float) -> None:
    """Turn one joint, the others stand still. ``UsageError`` beyond its limits, ``Refused`` when something is near."""
    model = hands.settings.arm_model
    place = check_joint_step(model, name, by_rad)
    goal = _inside(model, joints_of(hands))
    goal[place] = joints_of(hands)[place] + by_rad
    joint = model.joints[place]
    if not joint.lower_rad <= goal[place] <= joint.upper_rad:
        raise UsageError(
            f"{name} by {by_rad:g} rad would stand at {goal[place]:.3f} rad, "
            f"outside its limits {joint.lower_rad:.3f} to {joint.upper_rad:.3f}; make a smaller step"
        )
    await _step(hands, goal, speed_rad_s, f"{name} by {by_rad:g} rad")


async def jog_nozzle(hands: ByHand, by_m: tuple[float, float, float], speed_rad_s: float) -> None:
    """Shift the nozzle in the base frame; the direction in which it sprays is kept."""
    check_nozzle_step(by_m)
    model, what = hands.settings.arm_model, f"the nozzle by {_numbers(by_m)} m"
    joints = joints_of(hands)
    frames = link_frames(model, joints)
    goal_m = frames.nozzle_m + hands.settings.base_from_arm.inverse().rotate(by_m)
    found = nearest_solution(model, goal_m, frames.spray_axis, _inside(model, joints))
    if found is None:
        reach = inverse_kinematics(model, goal_m, frames.spray_axis, joints).in_reach.any()
        why = "no joint angles inside the limits" if reach else "out of the arm's reach"
        raise Refused(f"{what}: {why}; make a smaller step, or turn the nozzle with joint steps first")
    most = int(np.abs(found - joints).argmax())
    if abs(found[most] - joints[most]) > LONGEST_STEP_RAD:
        raise Refused(
            f"{what}: {model.joint_names[most]} would turn by {found[most] - joints[most]:.2f} rad to keep the "
            "nozzle's direction; go there with joint steps"
        )
    await _step(hands, found, speed_rad_s, what)


async def go_home(hands: ByHand, speed_rad_s: float) -> None:
    """To the stow posture on a way that touches nothing; at once when the arm is there already."""
    if hands.actuation.arm_stowed:
        hands.tell("the arm is stowed already")
        return
    way = await _way(hands, np.array(hands.settings.stow_rad), speed_rad_s, "the way home")
    await hands.record("arm home")
    await hands.actuation.move_arm(way)


async def settle(hands: ByHand) -> None:
    """Hold where the arm is and prove that it stands: what safety wants to see before a shot."""
    joints = tuple(float(angle) for angle in joints_of(hands))
    await hands.actuation.move_arm(JointTrajectory((0.0,), (joints,)))


def joints_of(hands: ByHand) -> Vector:
    """The joint angles as read last."""
    joints = hands.actuation.joints_rad
    if joints is None:
        raise DeviceError("arm", "a reading of the joints", "none", "check the arm's bus")
    return np.array(joints)


def nozzle_in_base(hands: ByHand) -> tuple[Vector, Vector]:
    """Nozzle tip (3,) in metres and unit spray axis (3,), base frame."""
    frames = link_frames(hands.settings.arm_model, joints_of(hands))
    base_from_arm = hands.settings.base_from_arm
    return base_from_arm.apply(frames.nozzle_m), base_from_arm.rotate(frames.spray_axis)


async def _step(hands: ByHand, goal_rad: Vector, speed_rad_s: float, what: str) -> None:
    """Straight in joint space, or not at all: an operator who asks for a step expects no detour."""
    way = await _way(hands, goal_rad, speed_rad_s, what)
    if not _is_straight(way):
        raise Refused(f"{what}: something is near the straight way; go around it in smaller steps")
    await hands.record(f"jog {what}")
    await hands.actuation.move_arm(way)


async def _way(hands: ByHand, goal_rad: Vector, speed_rad_s: float, what: str) -> JointTrajectory:
    """A collision-free trajectory with the rover's body as the obstacle; ``Refused`` with the planner's reason."""
    settings, start = hands.settings, joints_of(hands)
    aiming = replace(settings.aiming, max_velocity_rad_s=min(speed_rad_s, settings.aiming.max_velocity_rad_s))
    plan = await work(
        lambda: plan_joints(start, goal_rad, settings.arm_model, aiming, settings.rover_body), settings.plan_duration_s
    )
    if isinstance(plan, Unreachable):
        raise Refused(f"{what}: {plan.reason}; the arm stays where it is")
    return plan


def _is_straight(way: JointTrajectory) -> bool:
    points = np.array(way.positions_rad)
    whole = points[-1] - points[0]
    length = float(np.linalg.norm(whole))
    if length == 0.0:
        return True
    along = (points - points[0]) @ whole / length
    beside = np.abs(points - points[0] - along[:, None] * whole / length).max()
    return bool(beside <= STRAIGHT_RAD and (np.diff(along) >= -STRAIGHT_RAD).all())


def _inside(model: ArmModel, joints_rad: Vector) -> Vector:
    """A joint that stands a hair outside its limits is meant to stand on them."""
    return np.asarray(np.clip(joints_rad, model.lower_rad, model.upper_rad))


def _numbers(values: tuple[float, ...]) -> str:
    return " ".join(f"{value:g}" for value in values)

"""Moving the arm from where it is, off the loop for planning, through actuation for motion."""

from __future__ import annotations

import numpy as np

from drivers.errors import DeviceError
from robot.aiming import Obstacles, Unreachable, plan_joints
from robot.clock import work
from robot.mission.context import MissionContext
from robot.mission.scenery import obstacles


async def move_arm_to(context: MissionContext, goal_rad: tuple[float, ...], name: str) -> None:
    """A collision-free move to joint angles; ``DeviceError`` when there is none."""
    joints = present_joints(context)
    around: Obstacles = obstacles(context)
    settings = context.settings
    start, goal = np.array(joints), np.array(goal_rad)
    plan = await work(
        lambda: plan_joints(start, goal, settings.arm_model, settings.aiming, around), settings.plan_duration_s
    )
    if isinstance(plan, Unreachable):
        raise DeviceError(
            "arm", f"a collision-free path to '{name}'", plan.reason, "clear the arm's surroundings or move it by hand"
        )
    await context.actuation.move_arm(plan)


def present_joints(context: MissionContext) -> tuple[float, ...]:
    joints = context.actuation.joints_rad
    if joints is None:
        raise DeviceError("arm", "a reading of the joints", "none", "check the arm's bus")
    return joints

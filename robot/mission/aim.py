"""AIM: choose the next target and bring the nozzle in front of it."""

from __future__ import annotations

import asyncio
import math

import numpy as np

from drivers.errors import DeviceTimeout
from robot.actuation import Refused
from robot.aiming import AimPlan, Unreachable, motion_limits, plan, visiting_order
from robot.clock import work
from robot.mission.arm_moves import present_joints
from robot.mission.context import MissionContext
from robot.mission.detect import chosen
from robot.mission.events import TargetSkipped
from robot.mission.move import stow
from robot.mission.scenery import arm_from_row, obstacles
from robot.mission.transitions import Event
from robot.targets import TargetState

PUSHED_M = 0.02  # more than the pose filter wanders while the rover stands


async def aim(context: MissionContext) -> Event:
    """AIMED with the arm settled and the pressure up, or NO_TARGETS with the arm stowed and the pump off.

    BASE_MOVED when the base rolls, or was moved since the targets were seen: they must be seen again.
    """
    if not _disturbed(context):
        try:
            return await _aim(context)
        except Refused:
            if not _disturbed(context):
                raise
    context.progress.queue = None
    return Event.BASE_MOVED


def _disturbed(context: MissionContext) -> bool:
    """By the wheels, or, when they skidded, by satellites."""
    seen_from, now = context.progress.frame_pose, context.localiser.pose
    pushed = seen_from is not None and math.hypot(now.x_m - seen_from.x_m, now.y_m - seen_from.y_m) > PUSHED_M
    return pushed or context.actuation.base_disturbed


async def _aim(context: MissionContext) -> Event:
    progress = context.progress
    if progress.queue is None:
        progress.queue = await _queue(context)
    while progress.queue:
        target_id = progress.queue.pop(0)
        planned = await _plan(context, target_id, present_joints(context))
        if isinstance(planned, Unreachable):
            await _unreachable(context, target_id, planned)
            continue
        await context.actuation.start_pump()
        await context.actuation.move_arm(planned.trajectory)
        await _wait_for_pressure(context)
        progress.aimed = target_id
        return Event.AIMED
    await context.actuation.stop_pump()
    await stow(context)
    return Event.NO_TARGETS


async def _queue(context: MissionContext) -> list[int]:
    """The targets to treat at this stop, in the order that costs the least travel."""
    joints = present_joints(context)
    goals: dict[int, tuple[float, ...]] = {}
    for target_id in chosen(context):
        planned = await _plan(context, target_id, joints)
        if isinstance(planned, AimPlan):
            goals[target_id] = planned.goal_rad
        else:
            await _unreachable(context, target_id, planned)
    ids = list(goals)
    if not ids:
        return []
    settings = context.settings
    sequence = visiting_order(
        np.array([goals[target_id] for target_id in ids]),
        np.array(joints),
        motion_limits(settings.arm_model, settings.aiming),
        np.array(settings.stow_rad),
    )
    return [ids[index] for index in sequence]


async def _plan(context: MissionContext, target_id: int, joints: tuple[float, ...]) -> AimPlan | Unreachable:
    target = context.target(target_id)
    settings = context.settings
    centre_m = arm_from_row(context).apply(target.centre_m)
    around = obstacles(context, but=target_id)
    return await work(
        lambda: plan(centre_m, target.diameter_m, np.array(joints), settings.arm_model, settings.aiming, around),
        settings.plan_duration_s,
    )


async def _unreachable(context: MissionContext, target_id: int, why: Unreachable) -> None:
    """Recorded with the reason; a later stop may still reach it."""
    await context.set_state(target_id, TargetState.UNREACHABLE, str(why.reason))
    context.publish(TargetSkipped(target_id, context.progress.stop, str(why.reason)))


async def _wait_for_pressure(context: MissionContext) -> None:
    settings = context.settings
    deadline_s = context.now_s() + settings.pressure_timeout_s
    while True:
        reading = context.actuation.sensors
        if reading is not None and reading.pressure_bar >= settings.pressure_ready_bar:
            return
        if context.now_s() > deadline_s:
            found = "no reading" if reading is None else f"{reading.pressure_bar:.2f} bar"
            raise DeviceTimeout(
                "pump",
                f"{settings.pressure_ready_bar:.2f} bar within {settings.pressure_timeout_s} s",
                found,
                "check tank, suction filter, pump and its relay",
            )
        await asyncio.sleep(0.05)

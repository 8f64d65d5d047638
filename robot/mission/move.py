"""MOVE: stow the arm, drive to the next stop."""

from __future__ import annotations

import asyncio

from drivers.errors import DeviceError, DeviceTimeout
from robot import navigation
from robot.mission.arm_moves import move_arm_to
from robot.mission.context import MissionContext
from robot.mission.rolling import RollingWatch
from robot.mission.transitions import Event
from robot.targets import TargetState, wanted

CHECKPOINT_EVERY_M = 0.1


async def move(context: MissionContext) -> Event:
    """Drive to the next stop; after the last one close the book.

    ``DeviceTimeout`` when the base does not get there, ``DeviceFault`` when its wheels do not turn.
    """
    await stow(context)
    progress = context.progress
    stops = context.settings.row.stops
    if progress.stop >= len(stops):
        await close_book(context)
        return Event.ROUTE_DONE
    progress.stop += 1
    progress.queue, progress.seen, progress.aimed = None, frozenset(), None
    await context.checkpoint()
    await _drive_to(context, stops[progress.stop - 1].x_m)
    return Event.ARRIVED


async def stow(context: MissionContext) -> None:
    """Fold the arm away; at once when it is stowed already."""
    if not context.actuation.arm_stowed:
        await move_arm_to(context, context.settings.stow_rad, "stow")


async def close_book(context: MissionContext) -> None:
    """What is still open after the last stop will not be treated: say why."""
    for target in context.progress.book.in_state(TargetState.OPEN):
        verdict = wanted(target, context.settings.policy)
        if verdict.wanted:
            reason = target.reason or "not reached from any stop"
            await context.set_state(target.id, TargetState.UNREACHABLE, reason)
        else:
            await context.set_state(target.id, verdict.state, verdict.reason)


async def _drive_to(context: MissionContext, goal_x_m: float) -> None:
    drive = context.settings.drive
    start_x_m = written_x_m = context.localiser.pose.x_m
    deadline_s = context.now_s() + 10.0 + 3.0 * abs(goal_x_m - start_x_m) / drive.max_speed_m_s
    commanded_m_s = 0.0
    rolling = RollingWatch()
    while True:
        reading = context.actuation.odometry
        if reading is None:
            raise DeviceError("wheels", "an odometry reading", "none", "check the drive's connection")
        rolling.check(reading, commanded_m_s)
        pose = context.localiser.pose
        order = navigation.command(pose, goal_x_m, reading.speed_m_s, commanded_m_s, drive)
        if order.arrived:
            break
        if context.now_s() > deadline_s:
            raise DeviceTimeout(
                "wheels", f"the rover at {goal_x_m:.3f} m", f"at {pose.x_m:.3f} m", "look for what blocks or slips"
            )
        await context.actuation.drive(order.speed_m_s, order.yaw_rate_rad_s)
        commanded_m_s = order.speed_m_s
        if abs(pose.x_m - written_x_m) >= CHECKPOINT_EVERY_M:
            written_x_m = pose.x_m
            await context.checkpoint()
        await asyncio.sleep(drive.period_s)
    await context.actuation.halt_base()

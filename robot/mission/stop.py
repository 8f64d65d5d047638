"""STOP: halt, settle, know where the base stands, and have the arm out of the camera's way."""

from __future__ import annotations

import asyncio

from drivers.errors import DeviceTimeout
from robot.mission.context import MissionContext
from robot.mission.move import stow
from robot.mission.transitions import Event
from robot.safety.timing import BASE_STILL_M_S

STILL_FOR_S = 0.3


async def stop(context: MissionContext) -> Event:
    """Returns when odometry has shown standstill for ``STILL_FOR_S``; ``DeviceTimeout`` when it never does.

    The arm is stowed already after MOVE, and is stowed now when the base moved while it was aiming.
    """
    await context.actuation.halt_base()
    await _stand_still(context)
    context.progress.frame_pose = None  # where the plants are is judged from the present pose
    await stow(context)
    await context.checkpoint()
    return Event.SETTLED


async def _stand_still(context: MissionContext) -> None:
    begun_s = context.now_s()
    still_since_s: float | None = None
    while True:
        reading = context.actuation.odometry
        if reading is None or abs(reading.speed_m_s) > BASE_STILL_M_S:
            still_since_s = None
        elif still_since_s is None:
            still_since_s = reading.stamp_s
        elif reading.stamp_s - still_since_s >= STILL_FOR_S:
            return
        if context.now_s() - begun_s > context.settings.stop_timeout_s:
            found = "no reading" if reading is None else f"{reading.speed_m_s:.3f} m/s"
            raise DeviceTimeout(
                "wheels", f"standstill within {context.settings.stop_timeout_s} s", found, "check the drive's brake"
            )
        await asyncio.sleep(0.05)

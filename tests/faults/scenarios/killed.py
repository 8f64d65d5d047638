"""A mission whose process is killed in the middle of its first shot."""

from __future__ import annotations

import asyncio
import os
import signal
from pathlib import Path

from tests.robot.mission.conftest import SHORT
from tests.robot.mission.rover import World, spray_row


def spray_and_be_killed(folder: str) -> None:
    async def kill(world: World) -> None:
        await world.until_valve_opens()
        await asyncio.sleep(0.05)
        os.kill(os.getpid(), signal.SIGKILL)

    spray_row(Path(folder), meddler=kill, **SHORT)

"""Stopping one part: again when it fails, each try with its own deadline, the error reported and not raised."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable

from drivers.errors import DeviceError
from robot.actuation.values import PartStopped
from robot.safety.timing import CLOSE_DEADLINE_S, CLOSE_TRIES


async def stop_part(name: str, action: Callable[[], Awaitable[None]]) -> PartStopped:
    error = ""
    for _ in range(CLOSE_TRIES):
        try:
            async with asyncio.timeout(CLOSE_DEADLINE_S):
                await action()
        except (DeviceError, TimeoutError) as failure:
            error = str(failure) or "no answer in time"
        else:
            return PartStopped(name, "")
    return PartStopped(name, error)

"""Stopping one part: again when it fails, each try with its own deadline, the error reported and not raised."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable

from robot.actuation.values import PartStopped
from robot.safety.timing import CLOSE_DEADLINE_S, CLOSE_TRIES


async def stop_part(name: str, action: Callable[[], Awaitable[None]]) -> PartStopped:
    error = ""
    for _ in range(CLOSE_TRIES):
        try:
            async with asyncio.timeout(CLOSE_DEADLINE_S):
                await action()
        except TimeoutError:
            error = "no answer in time"
        except Exception as failure:  # noqa: BLE001 - a stop goes on past every error, a driver's bug included
            error = str(failure) or type(failure).__name__
        else:
            return PartStopped(name, "")
    return PartStopped(name, error)

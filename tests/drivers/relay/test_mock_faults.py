"""Faults that only a mock can show: a Modbus board has no stamps of its own."""

from __future__ import annotations

import asyncio

from drivers.relay.mock import MockRelay
from robot.clock import run_virtual
from tests.drivers.twin import rig


def test_a_stale_reading_carries_its_old_stamp() -> None:
    async def main() -> None:
        clock = asyncio.get_running_loop().time
        board = MockRelay(rig.twin("relay:delayed@1s"), clock)
        await board.open()
        await asyncio.sleep(5.0)
        assert clock() - (await board.read()).stamp_s > 0.9

    run_virtual(main())

"""The base is halted from any thread, also when the owner of its port hangs."""

from __future__ import annotations

import asyncio
import threading

import pytest

from drivers.errors import DeviceRefused
from tests.contract.rigs.wheels import WheelsRig
from tests.drivers.wheels.bench import drive, now, run, speed_m_s

SPEED = 0.2
LONG_S = 10.0  # the controller's own time-out is not what stops the base in these tests


async def stands(bench: WheelsRig, longest_s: float = 1.5) -> None:
    end_s = now() + longest_s
    while abs(speed_m_s(bench)) > 0.001:
        assert now() < end_s, "the base goes on"
        await asyncio.sleep(0.02)


def test_a_posted_stop_halts_the_base_and_nothing_moves_it_until_it_is_released() -> None:
    async def test(bench: WheelsRig) -> None:
        await drive(bench, 1.0, SPEED)
        stop = await asyncio.to_thread(bench.device.stop_lane.post, "the event loop stalled")
        await asyncio.wrap_future(stop)
        await stands(bench)
        with pytest.raises(DeviceRefused, match="the event loop stalled"):
            await bench.device.drive(SPEED, 0.0)
        await bench.device.drive(0.0, 0.0)
        await bench.device.stop()
        assert abs(speed_m_s(bench)) < 0.001
        bench.device.stop_lane.release()
        await drive(bench, 0.5, SPEED)
        assert speed_m_s(bench) > 0.05

    run(test)


def test_beside_an_owner_that_hangs_the_base_is_halted() -> None:
    async def test(bench: WheelsRig) -> None:
        await drive(bench, 1.0, SPEED)
        gate = threading.Event()
        hanging = asyncio.ensure_future(bench.master.run(lambda line: gate.wait(10.0)))
        await asyncio.sleep(0.02)
        stopping = bench.device.stop_lane.post("of a test")
        assert await asyncio.to_thread(bench.device.stop_lane.force)
        await stands(bench)
        assert not stopping.done()
        gate.set()
        await hanging
        await asyncio.wrap_future(stopping)

    run(test, command_timeout_s=LONG_S)

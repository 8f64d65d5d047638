"""What only the mock can show: exact pace, and stamps that tell of a delay. A stream carries no stamps."""

from __future__ import annotations

import asyncio

import pytest

from drivers.camera.mock import MockCamera
from robot.clock import run_virtual
from tests.drivers.twin import rig


def test_the_mock_runs_exactly_at_its_rate() -> None:
    async def main() -> None:
        twin = rig.twin()
        device = MockCamera(twin, asyncio.get_running_loop().time)
        await device.open()
        first = await device.capture()
        await asyncio.sleep(1.0)
        later = await device.capture()
        rate = (later.sequence - first.sequence) / (later.stamp_s - first.stamp_s)
        assert rate == pytest.approx(twin.nominal.camera_rate_hz, rel=1e-6)

    run_virtual(main())


def test_a_delayed_camera_shows_its_age() -> None:
    async def main() -> None:
        clock = asyncio.get_running_loop().time
        device = MockCamera(rig.twin("camera:delayed@1s"), clock)
        await device.open()
        await asyncio.sleep(1.0)
        called_s = clock()
        assert (await device.capture()).stamp_s < called_s - 0.5

    run_virtual(main())

"""A watched camera gives good pairs or says what is wrong; the camera under it is the twin's."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable

import numpy as np
import pytest

from drivers.camera.frame_watch import FrameWatch
from drivers.camera.mock import MockCamera
from drivers.camera.watched import WatchedCamera
from drivers.errors import DeviceFault, DeviceTimeout
from drivers.twin import Twin
from robot.clock import run_virtual
from tests.drivers.camera.scenes import calibration
from tests.drivers.twin import rig

Test = Callable[[WatchedCamera, Twin], Awaitable[None]]


def watch(test: Test, *faults: str) -> None:
    async def main() -> None:
        clock = asyncio.get_running_loop().time
        twin = rig.twin(*faults)
        device = WatchedCamera(MockCamera(twin, clock), FrameWatch(calibration()), clock)
        await device.open()
        await test(device, twin)
        await device.close()

    run_virtual(main())


def now() -> float:
    return asyncio.get_running_loop().time()


def test_good_pairs_pass_as_they_are() -> None:
    async def test(device: WatchedCamera, twin: Twin) -> None:
        assert device.image_size == twin.nominal.optics.image_size
        frame = await device.capture()
        left, right = twin.expose(frame.stamp_s, frame.exposure_s, frame.gain, frame.sequence)
        assert np.array_equal(frame.left, left)
        assert np.array_equal(frame.right, right)
        await device.set_exposure(0.002, 2.0)
        assert (await device.capture()).exposure_s == 0.002

    watch(test)


def test_a_frozen_picture_is_given_once_at_most() -> None:
    async def test(device: WatchedCamera, twin: Twin) -> None:
        await asyncio.sleep(1.0)
        first = await device.capture()  # nobody can tell yet
        for _ in range(2):
            with pytest.raises(DeviceFault, match="identical"):
                await device.capture()
        assert first.stamp_s < 1.2
        await asyncio.sleep(2.0)
        await device.capture()

    watch(test, "camera:stuck@1s+2s")


def test_swapped_views_are_a_fault_that_names_the_remedy() -> None:
    async def test(device: WatchedCamera, twin: Twin) -> None:
        with pytest.raises(DeviceFault, match="change left and right") as caught:
            await device.capture()
        assert caught.value.device == "camera"

    watch(test, "camera:wrong")


def test_a_fault_that_passes_within_a_second_is_waited_for() -> None:
    async def test(device: WatchedCamera, twin: Twin) -> None:
        await asyncio.sleep(1.0)
        frame = await device.capture()
        assert frame.stamp_s > 1.4
        assert now() < 2.0

    watch(test, "camera:wrong@1s+0.5s")


def test_a_fault_that_stays_is_told_after_a_second() -> None:
    async def test(device: WatchedCamera, twin: Twin) -> None:
        await asyncio.sleep(1.0)
        with pytest.raises(DeviceFault, match="swapped"):
            await device.capture()
        assert 2.0 <= now() < 2.5

    watch(test, "camera:wrong@1s")


def test_what_the_camera_itself_says_passes_unchanged() -> None:
    async def test(device: WatchedCamera, twin: Twin) -> None:
        await asyncio.sleep(1.0)
        with pytest.raises(DeviceTimeout):
            await device.capture()

    watch(test, "camera:off@1s")

"""What every stereo camera keeps, judged by the light and the poses of the twin."""

from __future__ import annotations

import asyncio

import numpy as np
import pytest

from drivers.camera.interface import StereoCamera
from drivers.errors import DeviceFault, DeviceLost, DeviceMissing, DeviceRefused, DeviceTimeout
from drivers.relay.values import Channel
from drivers.twin import Twin
from drivers.twin import commands as c
from tests.contract.conftest import CAMERAS, Bench
from tests.contract.rigs.camera import RECORDINGS


@pytest.fixture(params=[name for name in CAMERAS if name not in RECORDINGS])
def live_camera(request: pytest.FixtureRequest) -> Bench[StereoCamera]:
    """A camera that looks at the twin as it is, not as it was recorded."""
    return CAMERAS[request.param]


def now() -> float:
    return asyncio.get_running_loop().time()


def test_a_frame_is_a_pair_of_colour_images_of_the_cameras_size(camera: Bench[StereoCamera]) -> None:
    async def test(device: StereoCamera, twin: Twin) -> None:
        frame = await device.capture()
        width, height = device.image_size
        for view in (frame.left, frame.right):
            assert view.shape == (height, width, 3)
            assert view.dtype == np.uint8
            assert view.std() > 5.0
        assert not np.array_equal(frame.left, frame.right)

    camera.run(test)


def test_the_exposure_begins_after_the_call(camera: Bench[StereoCamera]) -> None:
    async def test(device: StereoCamera, twin: Twin) -> None:
        for wait_s in (0.0, 0.0123, 0.05):
            await asyncio.sleep(wait_s)
            called_s = now()
            frame = await device.capture()
            assert called_s <= frame.stamp_s - 0.5 * frame.exposure_s + 1e-9
            assert frame.stamp_s + 0.5 * frame.exposure_s <= now()

    camera.run(test)


def test_sequence_numbers_rise_with_the_stamps(camera: Bench[StereoCamera]) -> None:
    async def test(device: StereoCamera, twin: Twin) -> None:
        first = await device.capture()
        second = await device.capture()
        await asyncio.sleep(1.0)
        third = await device.capture()
        rate = (third.sequence - first.sequence) / (third.stamp_s - first.stamp_s)
        assert first.sequence < second.sequence < third.sequence
        assert 0.2 * twin.nominal.camera_rate_hz < rate < 1.1 * twin.nominal.camera_rate_hz  # a busy machine loses some

    camera.run(test)


def test_a_longer_exposure_gives_a_brighter_picture(live_camera: Bench[StereoCamera]) -> None:
    async def test(device: StereoCamera, twin: Twin) -> None:
        await device.set_exposure(0.001, 1.0)
        dark = await device.capture()
        await device.set_exposure(0.004, 1.0)
        bright = await device.capture()
        assert (dark.exposure_s, bright.exposure_s) == (0.001, 0.004)
        assert bright.left.mean() > 1.5 * dark.left.mean()

    live_camera.run(test)


def test_gain_brightens_too(live_camera: Bench[StereoCamera]) -> None:
    async def test(device: StereoCamera, twin: Twin) -> None:
        await device.set_exposure(0.001, 1.0)
        dark = await device.capture()
        await device.set_exposure(0.001, 4.0)
        bright = await device.capture()
        assert bright.gain == 4.0
        assert bright.left.mean() > 1.5 * dark.left.mean()

    live_camera.run(test)


@pytest.mark.parametrize(("exposure_s", "gain"), [(0.0, 1.0), (1.0, 1.0), (0.004, 0.5), (0.004, 100.0)])
def test_exposure_and_gain_outside_the_bounds_are_refused(
    live_camera: Bench[StereoCamera], exposure_s: float, gain: float
) -> None:
    async def test(device: StereoCamera, twin: Twin) -> None:
        with pytest.raises(ValueError, match="expected"):
            await device.set_exposure(exposure_s, gain)
        assert (await device.capture()).exposure_s == twin.nominal.exposure_s

    live_camera.run(test)


def test_the_picture_moves_with_the_base(live_camera: Bench[StereoCamera]) -> None:
    async def test(device: StereoCamera, twin: Twin) -> None:
        before = await device.capture()
        again = await device.capture()
        noise = np.abs(before.left.astype(int) - again.left).mean()
        twin.apply(now(), c.WorldPush(0.10, 0.0, 0.0))
        after = await device.capture()
        assert np.abs(before.left.astype(int) - after.left).mean() > 3.0 * noise

    live_camera.run(test)


def test_the_lamp_lights_the_picture_at_dusk(live_camera: Bench[StereoCamera]) -> None:
    async def test(device: StereoCamera, twin: Twin) -> None:
        await device.set_exposure(0.0005, 1.0)
        off = await device.capture()
        twin.apply(now(), c.RelaySwitch(Channel.LAMP, True, now()))
        on = await device.capture()
        assert on.left.mean() > off.left.mean() + 1.0

    live_camera.run(test)


def test_an_absent_camera_is_missing(live_camera: Bench[StereoCamera]) -> None:
    async def test(device: StereoCamera, twin: Twin) -> None:
        with pytest.raises(DeviceMissing):
            await device.open()

    live_camera.run(test, "camera:off", opened=False)


def test_a_camera_that_dies_ends_in_a_timeout(live_camera: Bench[StereoCamera]) -> None:
    async def test(device: StereoCamera, twin: Twin) -> None:
        await asyncio.sleep(1.0)
        with pytest.raises(DeviceTimeout):
            await device.capture()

    live_camera.run(test, "camera:off@1s")


def test_a_closed_camera_is_lost(camera: Bench[StereoCamera]) -> None:
    async def test(device: StereoCamera, twin: Twin) -> None:
        await device.close()
        with pytest.raises(DeviceLost):
            await device.capture()

    camera.run(test)


def test_a_torn_frame_is_a_fault(live_camera: Bench[StereoCamera]) -> None:
    async def test(device: StereoCamera, twin: Twin) -> None:
        await asyncio.sleep(1.0)
        with pytest.raises(DeviceFault):
            await device.capture()

    live_camera.run(test, "camera:garbage@1s")


def test_a_frozen_camera_serves_the_same_picture_with_new_stamps(live_camera: Bench[StereoCamera]) -> None:
    async def test(device: StereoCamera, twin: Twin) -> None:
        await asyncio.sleep(1.0)
        first = await device.capture()
        second = await device.capture()
        assert np.array_equal(first.left, second.left)
        assert second.stamp_s > first.stamp_s

    live_camera.run(test, "camera:stuck@1s")


@pytest.mark.parametrize("name", RECORDINGS)
def test_the_exposure_of_a_recording_is_fixed(name: str) -> None:
    async def test(device: StereoCamera, twin: Twin) -> None:
        before = await device.capture()
        await device.set_exposure(before.exposure_s, before.gain)
        with pytest.raises(DeviceRefused, match="recording"):
            await device.set_exposure(2.0 * before.exposure_s, before.gain)
        after = await device.capture()
        assert (after.exposure_s, after.gain) == (before.exposure_s, before.gain)

    CAMERAS[name].run(test)

"""The USB driver on the emulated stream: what a camera in the field does to it."""

from __future__ import annotations

import asyncio
import shutil
import socket
from pathlib import Path

import cv2
import numpy as np
import pytest

from drivers.camera.controls import Control
from drivers.camera.stereo_usb import StereoUsb
from drivers.camera.stereo_usb_settings import StereoUsbSettings
from drivers.camera.values import Image, StereoFrame
from drivers.errors import (
    DeviceError,
    DeviceFault,
    DeviceLost,
    DeviceMissing,
    DeviceRefused,
    WrongDevice,
)
from drivers.twin import commands as c
from tests.contract.rigs.camera import settings_for
from tests.drivers.camera.rig import opened, plugged, run
from tests.drivers.twin import rig

BACK_S = 12.0


def now() -> float:
    return asyncio.get_running_loop().time()


def driver(settings: StereoUsbSettings) -> StereoUsb:
    return StereoUsb(settings, asyncio.get_running_loop().time)


async def captures_for_ever(device: StereoUsb) -> None:
    while True:
        await device.capture()


def apart(one: Image, other: Image) -> float:
    """Mean difference of two pictures in codes."""
    return float(np.abs(one.astype(int) - other).mean())


async def until_it_gives(device: StereoUsb) -> StereoFrame:
    """The first frame after trouble."""
    end_s = now() + BACK_S
    while True:
        try:
            return await device.capture()
        except DeviceError:
            if now() > end_s:
                raise
            await asyncio.sleep(0.05)


async def trouble(device: StereoUsb) -> DeviceError:
    """What keeps the device from opening; it is told within three seconds."""
    began_s = now()
    with pytest.raises(DeviceError) as caught:
        await device.open()
    assert now() - began_s < 5.0  # three, and what a busy machine adds
    with pytest.raises(DeviceLost):
        await device.capture()
    return caught.value


def test_an_unplugged_camera_is_lost_and_comes_back_with_its_settings() -> None:
    async def main() -> None:
        twin = rig.twin()
        async with plugged(twin) as camera, opened(twin, camera.url) as device:
            await device.set_exposure(0.002, 2.0)
            await camera.unplug()
            with pytest.raises(DeviceLost, match="plug it in"):
                await captures_for_ever(device)
            await camera.plug()
            assert camera.controls["auto_exposure"] == 1.0  # it wakes up as from the factory
            frame = await until_it_gives(device)
            assert (frame.exposure_s, frame.gain) == (0.002, 2.0)
            assert (camera.controls["exposure_s"], camera.controls["gain"]) == (0.002, 2.0)
            assert camera.controls["auto_exposure"] == camera.controls["auto_white_balance"] == 0.0
            shown, _ = twin.expose(now(), 0.002, 2.0, 1)
            assert apart(frame.left, shown) < 4.0

    run(main)


def test_sequence_numbers_go_on_after_the_camera_was_away() -> None:
    async def main() -> None:
        twin = rig.twin()
        async with plugged(twin) as camera, opened(twin, camera.url) as device:
            before = await device.capture()
            await camera.unplug()
            await camera.plug()
            assert (await until_it_gives(device)).sequence > before.sequence

    run(main)


def test_the_picture_is_of_after_the_call_whatever_the_latency_is_said_to_be() -> None:
    async def main() -> None:
        twin = rig.twin()
        async with plugged(twin) as camera, opened(twin, camera.url, latency_s=0.0) as device:
            for step in range(1, 4):
                await device.capture()
                twin.apply(now(), c.WorldPush(0.05, 0.0, 0.0))
                frame = await device.capture()
                shown, _ = twin.expose(now(), frame.exposure_s, frame.gain, step)
                assert apart(frame.left, shown) < 4.0

    run(main)


def test_frames_come_with_the_light_of_the_exposure_that_they_tell() -> None:
    async def main() -> None:
        twin = rig.twin()
        async with plugged(twin) as camera, opened(twin, camera.url) as device:
            for exposure_s, gain in ((0.001, 1.0), (0.008, 1.0), (0.002, 4.0)):
                await device.set_exposure(exposure_s, gain)
                frame = await device.capture()
                shown, _ = twin.expose(now(), exposure_s, gain, 7)
                assert (frame.exposure_s, frame.gain) == (exposure_s, gain)
                assert apart(frame.left, shown) < 5.0

    run(main)


def test_an_exposure_between_two_steps_is_told_as_the_camera_made_it() -> None:
    async def main() -> None:
        twin = rig.twin()
        async with plugged(twin) as camera, opened(twin, camera.url) as device:
            await device.set_exposure(0.00234, 1.03)
            frame = await device.capture()
            assert (frame.exposure_s, frame.gain) == (0.0023, 1.0)

    run(main)


def test_a_control_that_does_not_keep_its_value_is_named() -> None:
    async def main() -> None:
        twin = rig.twin()
        async with plugged(twin) as camera:
            camera.controls.forgets.add("white_balance_k")
            error = await trouble(driver(settings_for(twin, camera.url)))
            assert isinstance(error, DeviceFault)
            assert "white_balance_k" in str(error)
            assert "5600" in error.expected
            assert "4600" in error.found
            allowed = frozenset({Control.WHITE_BALANCE_K})
            async with opened(twin, camera.url, may_differ=allowed) as device:
                await device.capture()

    run(main)


def test_a_camera_that_lacks_a_control_is_refused_by_its_name() -> None:
    async def main() -> None:
        twin = rig.twin()
        async with plugged(twin) as camera:
            camera.controls.lacks |= {"gain", "power_line_hz"}
            error = await trouble(driver(settings_for(twin, camera.url, power_line_hz=None, gain=2.0)))
            assert isinstance(error, DeviceFault)
            assert "a control gain" in error.expected
            error = await trouble(driver(settings_for(twin, camera.url, power_line_hz=50)))
            assert "power_line_hz" in error.expected

    run(main)


def test_a_camera_without_a_gain_has_the_gain_one() -> None:
    async def main() -> None:
        twin = rig.twin()
        async with plugged(twin) as camera:
            camera.controls.lacks.add("gain")
            async with opened(twin, camera.url) as device:
                assert (await device.capture()).gain == 1.0
                with pytest.raises(ValueError, match="gain: expected 1 to 1"):
                    await device.set_exposure(0.004, 2.0)

    run(main)


def test_the_automatics_of_the_camera_are_off_and_stay_off() -> None:
    async def main() -> None:
        twin = rig.twin()
        async with plugged(twin) as camera, opened(twin, camera.url) as device:
            first = await device.capture()
            await asyncio.sleep(0.5)
            later = await device.capture()
            assert camera.controls["exposure_s"] == twin.nominal.exposure_s
            assert later.left.mean() == pytest.approx(first.left.mean(), rel=0.02)

    run(main)


def test_another_white_balance_is_another_picture() -> None:
    async def main() -> None:
        twin = rig.twin()
        means = []
        for kelvin in (3000.0, 6500.0):
            async with (
                plugged(twin) as camera,
                opened(twin, camera.url, white_balance_k=kelvin, power_line_hz=None) as device,
            ):
                means.append((await device.capture()).left.reshape(-1, 3).mean(axis=0))
        (blue_cold, _, red_cold), (blue_warm, _, red_warm) = means
        assert blue_cold / red_cold > 1.3 * blue_warm / red_warm

    run(main)


def test_a_camera_of_another_size_is_the_wrong_one_and_both_sizes_are_told() -> None:
    async def main() -> None:
        twin = rig.twin()
        async with plugged(twin) as camera:
            error = await trouble(driver(settings_for(twin, camera.url, image_size=(800, 600))))
            assert isinstance(error, WrongDevice)
            assert "1600x600" in error.expected
            assert "1280x480" in error.found

    run(main)


def test_an_address_that_gives_no_stream_is_the_wrong_device() -> None:
    async def main() -> None:
        twin = rig.twin()
        async with plugged(twin) as camera:
            page = await trouble(driver(settings_for(twin, camera.url_of("controls"))))
            assert isinstance(page, WrongDevice)
            assert "application/json" in page.found
            nothing = await trouble(driver(settings_for(twin, camera.url_of("nothing"))))
            assert isinstance(nothing, WrongDevice)
            assert "404" in nothing.found

    run(main)


def test_an_address_where_nobody_listens_is_a_missing_camera() -> None:
    async def main() -> None:
        with socket.socket() as door:
            door.bind(("127.0.0.1", 0))
            address = f"http://127.0.0.1:{door.getsockname()[1]}/stream"
            for controlled in (True, False):
                settings = settings_for(rig.twin(), address, controlled=controlled)
                assert isinstance(await trouble(driver(settings)), DeviceMissing)

    run(main)


def test_a_server_that_accepts_and_says_nothing_is_a_missing_camera() -> None:
    async def main() -> None:
        with socket.create_server(("127.0.0.1", 0)) as door:
            address = f"http://127.0.0.1:{door.getsockname()[1]}/stream"
            for controlled in (True, False):
                settings = settings_for(rig.twin(), address, controlled=controlled)
                assert isinstance(await trouble(driver(settings)), DeviceMissing)

    run(main)


def test_a_path_that_is_not_there_is_a_missing_camera(tmp_path: Path) -> None:
    async def main() -> None:
        error = await trouble(driver(settings_for(rig.twin(), str(tmp_path / "video0"))))
        assert isinstance(error, DeviceMissing)
        assert str(tmp_path / "video0") in str(error)

    run(main)


def test_a_path_that_is_no_camera_is_the_wrong_device(tmp_path: Path) -> None:
    async def main() -> None:
        other = tmp_path / "video0"
        other.write_bytes(b"")
        assert isinstance(await trouble(driver(settings_for(rig.twin(), str(other)))), WrongDevice)

    run(main)


def test_garbled_frames_are_faults_and_whole_ones_come_after() -> None:
    async def main() -> None:
        twin = rig.twin("camera:garbage@1.5s+1s")
        async with plugged(twin) as camera, opened(twin, camera.url) as device:
            await asyncio.sleep(max(0.0, 1.6 - now()))
            with pytest.raises(DeviceFault, match="garbled"):
                await captures_for_ever(device)
            assert device.statistics.garbled > 0
            await asyncio.sleep(max(0.0, 2.6 - now()))
            await device.capture()

    run(main)


def test_a_camera_that_loses_half_of_its_frames_still_gives_pairs() -> None:
    async def main() -> None:
        twin = rig.twin("camera:intermittent@1s")
        async with plugged(twin) as camera, opened(twin, camera.url) as device:
            await asyncio.sleep(max(0.0, 1.0 - now()))
            frames = [await device.capture() for _ in range(4)]
            assert [frame.sequence for frame in frames] == sorted({frame.sequence for frame in frames})

    run(main)


def test_swapped_views_are_put_right_by_the_setting() -> None:
    async def main() -> None:
        twin = rig.twin("camera:wrong")
        async with plugged(twin) as camera, opened(twin, camera.url, swapped=True) as device:
            frame = await device.capture()
            left, right = twin.expose(now(), frame.exposure_s, frame.gain, 7)
            assert apart(frame.left, left) < 4.0 < apart(frame.left, right)

    run(main)


def test_two_cameras_make_pairs_of_one_moment() -> None:
    async def main() -> None:
        twin = rig.twin()
        async with plugged(twin) as camera:
            places = camera.url_of("left"), camera.url_of("right")
            async with opened(twin, *places, pair_apart_s=0.03) as device:
                frame = await device.capture()
                left, right = twin.expose(now(), frame.exposure_s, frame.gain, 7)
                assert apart(frame.left, left) < 4.0
                assert apart(frame.right, right) < 4.0

    run(main)


def test_two_cameras_that_are_not_of_one_moment_are_a_fault() -> None:
    """F55."""

    async def main() -> None:
        twin = rig.twin()
        async with plugged(twin) as camera:
            places = camera.url_of("left"), camera.url_of("right")
            async with opened(twin, *places, pair_apart_s=0.02, frame_timeout_s=0.6) as device:
                camera.right_late_s = 0.035
                with pytest.raises(DeviceFault, match="views within 20 ms"):
                    await captures_for_ever(device)
                assert device.pairing.dropped > 0

    run(main)


def test_a_capture_that_is_cancelled_leaves_nobody_waiting() -> None:
    async def main() -> None:
        twin = rig.twin()
        async with plugged(twin) as camera, opened(twin, camera.url) as device:
            captures = [asyncio.create_task(device.capture()) for _ in range(5)]
            await asyncio.sleep(0.01)
            for task in captures[:-1]:
                task.cancel()
            outcomes = await asyncio.gather(*captures, return_exceptions=True)
            assert [isinstance(outcome, asyncio.CancelledError) for outcome in outcomes] == [True] * 4 + [False]

    run(main)


def test_settings_of_no_camera_and_of_the_same_camera_twice_are_refused() -> None:
    for places in ((), ("/dev/video0", "/dev/video0"), ("a", "b", "c")):
        with pytest.raises(ValueError, match="places"):
            StereoUsbSettings(places, (640, 480), 0.004)
    with pytest.raises(ValueError, match="in_flight_frames"):
        StereoUsbSettings(("/dev/video0",), (640, 480), 0.004, in_flight_frames=0)


@pytest.mark.skipif(shutil.which("ffmpeg") is None, reason="ffmpeg is not installed (apt install ffmpeg)")
def test_the_bare_stream_of_another_program_gives_its_pictures(tmp_path: Path) -> None:
    """ffmpeg serves a side-by-side recording at its pace; it has no controls, so its exposure is fixed."""
    twin = rig.twin()
    left, right = twin.expose(0.0, 0.004, 1.0, 1)
    recording = tmp_path / "pair.avi"
    writer = cv2.VideoWriter(str(recording), cv2.CAP_OPENCV_MJPEG, cv2.VideoWriter.fourcc(*"MJPG"), 15.0, (1280, 480))
    for _ in range(60):
        writer.write(np.hstack((left, right)))
    writer.release()
    with socket.socket() as door:
        door.bind(("127.0.0.1", 0))
        address = f"http://127.0.0.1:{door.getsockname()[1]}/"

    async def main() -> None:
        peer = await asyncio.create_subprocess_exec(
            "ffmpeg", "-v", "quiet", "-re", "-stream_loop", "-1", "-i", str(recording), "-c", "copy", "-f", "mpjpeg",
            "-listen", "1", address, stdin=asyncio.subprocess.DEVNULL,
        )  # fmt: skip
        try:
            device = driver(settings_for(twin, address, controlled=False))
            end_s = now() + 10.0
            while True:
                try:
                    await device.open()
                    break
                except DeviceMissing:
                    assert now() < end_s
                    await asyncio.sleep(0.05)
            frame = await device.capture()
            assert apart(frame.left, left) < 6.0
            assert apart(frame.right, right) < 6.0
            with pytest.raises(DeviceRefused, match="bare stream"):
                await device.set_exposure(0.002, 1.0)
            await device.close()
        finally:
            peer.kill()
            await peer.wait()

    run(main)

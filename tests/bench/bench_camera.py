"""The USB camera driver on the emulated stream (640x480 a view, side by side, 15 pairs a second), and the watch."""

from __future__ import annotations

import asyncio
import statistics
import time

import cv2
import numpy as np

from drivers.camera import frame_checks
from drivers.camera.darkroom import WorkerProcess
from drivers.camera.emulator import CameraEmulator
from drivers.camera.epipolar import StereoCalibration
from drivers.camera.frame_checks import grey_of
from drivers.camera.frame_watch import FrameWatch
from drivers.camera.pictures import picture_of
from drivers.camera.stereo_usb import StereoUsb
from drivers.camera.stereo_usb_settings import StereoUsbSettings
from drivers.camera.values import StereoFrame
from drivers.camera.view_matching import match
from drivers.twin import Twin
from tests.bench.lines import Say, measure, say
from tests.drivers.twin import rig

_LOOKS_S = 4.0


def decoding_and_watching(twin: Twin) -> None:
    frames = [StereoFrame(0.0, n, *twin.expose(0.0, 0.004, 1.0, n), 0.004, 1.0) for n in range(4)]
    whole = np.hstack((frames[0].left, frames[0].right))
    data = cv2.imencode(".jpg", whole, [cv2.IMWRITE_JPEG_QUALITY, 92])[1].reshape(-1)
    measure("camera: check and decode a side-by-side JPEG", 60, lambda: picture_of(data, "MJPG", (1280, 480)))
    optics = twin.nominal.optics
    watch = FrameWatch(
        StereoCalibration(
            optics.image_size, optics.K_left, optics.dist_left, optics.K_right, optics.dist_right, optics.R, optics.t_m
        )
    )
    numbers = iter(range(1_000_000))
    measure("camera: watch a pair for faults", 60, lambda: watch.look(frames[next(numbers) % 4]), "<= 15 ms")
    left, right = grey_of(frames[0].left), grey_of(frames[0].right)
    both = (left, right)
    measure("camera:   of it, black, covered, blurred", 60, lambda: [frame_checks.measure(view) for view in both])
    measure("camera:   of it, matches of both views", 60, lambda: match(left, right))


async def streaming(twin: Twin) -> None:
    clock = asyncio.get_running_loop().time
    emulator = CameraEmulator(twin, clock, WorkerProcess(twin.scene, twin.nominal.optics, twin.seed))
    await emulator.plug()
    life = asyncio.create_task(emulator.serve())
    settings = StereoUsbSettings(
        (emulator.url,), twin.nominal.optics.image_size, 0.004, latency_s=twin.nominal.camera_readout_s
    )
    device = StereoUsb(settings, clock)
    began_s = clock()
    await device.open()
    say("camera: open, controls verified, first pair", f"{1e3 * (clock() - began_s):8.0f} ms", "<= 3000 ms")
    waits_ms, ages_ms = [], []
    for number in range(30):
        await asyncio.sleep(0.013 * (number % 5))
        called_s = clock()
        frame = await device.capture()
        waits_ms.append(1e3 * (clock() - called_s))
        ages_ms.append(1e3 * (clock() - frame.stamp_s))
    period_ms = 1e3 / twin.nominal.camera_rate_hz
    say(
        "camera: capture() to its pair",
        f"median {statistics.median(waits_ms):8.1f} ms   worst {max(waits_ms):8.1f} ms",
        f"<= 3 periods of {period_ms:.0f} ms + readout",
    )
    say("camera: age of a pair when it is given", f"median {statistics.median(ages_ms):8.1f} ms")
    before, pairs = time.process_time(), device.statistics.pairs
    await asyncio.sleep(_LOOKS_S)
    pairs = device.statistics.pairs - pairs
    used_ms = 1e3 * (time.process_time() - before)
    say(
        "camera: driver and stream server, nobody asks",
        f"{used_ms / max(pairs, 1):8.2f} ms CPU a pair, {pairs / _LOOKS_S:.1f} pairs a second",
    )
    await device.close()
    life.cancel()
    await asyncio.gather(life, return_exceptions=True)


def bench(_say: Say) -> None:
    cv2.setNumThreads(1)
    twin = rig.twin()
    decoding_and_watching(twin)
    with asyncio.Runner(loop_factory=asyncio.SelectorEventLoop) as runner:
        runner.run(streaming(Twin(twin.nominal, twin.scene, twin.seed)))


if __name__ == "__main__":
    bench(say)

"""The stereo pair of an OAK camera (depthai 3): colour views, synchronised, with the camera's own time stamps."""

from __future__ import annotations

import asyncio
import math
import threading
from collections.abc import Callable
from dataclasses import dataclass
from datetime import timedelta
from typing import Any

from drivers.camera.depthai_pair import OakPair, add_sync, calibration_of, iso_of, load, pair_of, sockets, sync_inputs
from drivers.camera.epipolar import StereoCalibration
from drivers.camera.grabber import JOIN_S, Grab, Grabber, as_lost
from drivers.camera.values import StereoFrame
from drivers.camera.waiting_room import WaitingRoom
from drivers.errors import DeviceBusy, DeviceError, DeviceFault, DeviceLost, DeviceMissing, DeviceTimeout

BOOT_S = 20.0  # a camera that is there gets its firmware over USB first
LONGEST_CAPTURE_S = 5.0
HASTY_S = 0.5
_SETTLED = 0.05  # share by which an exposure may differ from what was asked
_SETTLE_PAIRS = 10
EXPOSURE_LIMITS_S = (20e-6, 0.033)  # OV9782 at 30 frames a second
GAIN_LIMITS = (1.0, 16.0)


@dataclass(frozen=True, slots=True)
class DepthAiSettings:
    """``device_id`` (the MX id or the address) chooses one of several cameras. ``image_size`` (width, height) a view.

    ``apart_s`` is how far apart the stamps of a pair may be. ``white_balance_k`` None leaves it to the camera.
    """

    image_size: tuple[int, int]
    exposure_s: float
    gain: float = 1.0
    rate_hz: float = 15.0
    device_id: str | None = None
    white_balance_k: int | None = 5600
    apart_s: float = 0.005
    frame_timeout_s: float = 0.5


class OakSource:
    """An open camera, in its owner thread. ``DeviceMissing`` within three seconds when there is none."""

    def __init__(self, settings: DepthAiSettings, exposure_s: float, gain: float) -> None:
        self._dai = dai = load()
        self._settings = settings
        self._device = _open_device(dai, settings.device_id)
        self._pipeline: Any = None
        try:
            self._build(exposure_s, gain)
            self.calibration = calibration_of(dai, self._device.readCalibration(), settings.image_size)
        except RuntimeError as error:
            self.close()
            raise DeviceFault("camera", "the camera to start", str(error), "unplug it and plug it in again") from error
        except BaseException:
            self.close()
            raise

    def _build(self, exposure_s: float, gain: float) -> None:
        dai, settings = self._dai, self._settings
        self._pipeline = pipeline = dai.Pipeline(self._device)
        sync = add_sync(dai, pipeline, settings.apart_s)
        self._controls = []
        eyes = sockets(dai, self._device.getConnectedCameraFeatures())
        for socket, sync_input in zip(eyes, sync_inputs(sync), strict=True):
            eye = pipeline.create(dai.node.Camera).build(socket, sensorFps=settings.rate_hz)
            self._control(eye.initialControl, exposure_s, gain)
            view = eye.requestOutput(
                settings.image_size, dai.ImgFrame.Type.BGR888i, dai.ImgResizeMode.CROP, settings.rate_hz
            )
            view.link(sync_input)
            self._controls.append(eye.inputControl.createInputQueue())
        self._pairs = sync.out.createOutputQueue(maxSize=1, blocking=False)
        pipeline.start()

    def _control(self, control: Any, exposure_s: float, gain: float) -> None:
        control.setManualExposure(timedelta(seconds=exposure_s), iso_of(gain))
        if self._settings.white_balance_k is not None:
            control.setManualWhiteBalance(self._settings.white_balance_k)

    def expose(self, exposure_s: float, gain: float) -> None:
        """Of the frames that follow, some frames later."""
        for queue in self._controls:
            control = self._dai.CameraControl()
            self._control(control, exposure_s, gain)
            queue.send(control)

    def next_frame(self) -> OakPair:
        try:
            group = self._pairs.get(timedelta(seconds=1.0))
            if group is None and self._device.isClosed():
                raise DeviceLost("camera", "the OAK camera to be there", "it gone", "plug it in again")
        except RuntimeError as error:  # the link broke, or the queue was closed with it
            raise DeviceLost("camera", "the OAK camera to be there", str(error), "plug it in again") from error
        if group is None:
            raise DeviceTimeout("camera", "a pair within 1 s", "silence", "check its cable and its power")
        return pair_of(self._dai, group)

    def age_s(self, pair: OakPair) -> float:
        """How long ago the middle of a pair's exposure was."""
        return float(self._dai.Clock.now().total_seconds()) - pair.middle_s

    def close(self) -> None:
        if self._pipeline is not None:
            self._pipeline.stop()
        self._device.close()


def _open_device(dai: Any, device_id: str | None) -> Any:
    found = dai.Device.getAllAvailableDevices()
    if not found:
        connected = dai.Device.getAllConnectedDevices()
        if connected:
            raise DeviceBusy("camera", "a free OAK camera", f"{connected[0].deviceId} in use", "end that program")
        raise DeviceMissing(
            "camera", "an OAK camera", "none", "plug it into a USB 3 port; check the udev rule for vendor 03e7"
        )
    known = {info.deviceId: info for info in found} | {info.name: info for info in found}
    if device_id is not None and device_id not in known:
        raise DeviceMissing(
            "camera", f"the OAK camera {device_id}", ", ".join(info.deviceId for info in found), "correct device_id"
        )
    try:
        return dai.Device(found[0] if device_id is None else known[device_id])
    except RuntimeError as error:
        raise DeviceMissing("camera", "the OAK camera to boot", str(error), "unplug it and plug it in again") from error


class DepthAiCamera:
    """Implements ``drivers.camera.interface.StereoCamera``; ``clock`` gives loop time and is read from the owner too.

    ``calibration`` is that in the camera's memory; None before the first ``open``.
    """

    def __init__(self, settings: DepthAiSettings, clock: Callable[[], float]) -> None:
        self.settings = settings
        self.calibration: StereoCalibration | None = None
        self._clock = clock
        self._grabber: Grabber[OakSource, tuple[OakPair, float]] | None = None
        self._room = WaitingRoom()
        self._mutex = threading.Lock()
        self._asked = settings.exposure_s, settings.gain
        self._pairs = 0
        self._unsettled = 0

    @property
    def image_size(self) -> tuple[int, int]:
        return self.settings.image_size

    async def open(self) -> None:
        self._room.clear()
        self._grabber = Grabber(self._start, _with_age, self._clock, self._take, self._suffer)
        waiting = self._room.enter(-math.inf, 0)
        is_open = False
        try:
            self._grabber.start()
            if await self._room.wait(waiting, BOOT_S, BOOT_S) is None:
                raise DeviceMissing("camera", f"a first pair within {BOOT_S:g} s", "none", "check its power and cable")
            is_open = True
        finally:
            self._room.leave(waiting)
            if not is_open:
                await self._let_go(HASTY_S)

    async def close(self) -> None:
        await self._let_go(JOIN_S)

    async def _let_go(self, patience_s: float) -> None:
        grabber, self._grabber = self._grabber, None
        self._room.fail(_closed())
        if grabber is not None:
            await grabber.stop(patience_s)

    async def capture(self) -> StereoFrame:
        self._require_open()
        waiting = self._room.enter(self._clock(), 0)
        try:
            frame = await self._room.wait(waiting, self.settings.frame_timeout_s, LONGEST_CAPTURE_S)
        finally:
            self._room.leave(waiting)
        if frame is None:
            raise DeviceTimeout(
                "camera", f"a pair within {self.settings.frame_timeout_s:g} s", "silence", "check its cable and power"
            )
        return frame

    async def set_exposure(self, exposure_s: float, gain: float) -> None:
        low_s, high_s = EXPOSURE_LIMITS_S[0], min(EXPOSURE_LIMITS_S[1], 1.0 / self.settings.rate_hz)
        if not low_s <= exposure_s <= high_s:
            raise ValueError(f"exposure: expected {low_s:g} to {high_s:g} s, found {exposure_s:g} s; choose one within")
        if not GAIN_LIMITS[0] <= gain <= GAIN_LIMITS[1]:
            raise ValueError(
                f"gain: expected {GAIN_LIMITS[0]:g} to {GAIN_LIMITS[1]:g}, found {gain:g}; choose one within"
            )
        grabber = self._require_open()
        with self._mutex:
            self._asked, self._unsettled = (exposure_s, gain), 0
        await asyncio.wait_for(
            asyncio.wrap_future(grabber.post(lambda source: source.expose(exposure_s, gain))), LONGEST_CAPTURE_S
        )

    def _require_open(self) -> Grabber[OakSource, tuple[OakPair, float]]:
        if self._grabber is None:
            raise _closed()
        return self._grabber

    # --- in the owner thread

    def _start(self) -> OakSource:
        source = OakSource(self.settings, *self._asked)
        self.calibration = source.calibration
        return source

    def _take(self, grab: Grab[tuple[OakPair, float]]) -> None:
        pair, age_s = grab.data
        with self._mutex:
            self._pairs += 1
            number, asked = self._pairs, self._asked
            settled = _settled(pair, *asked)
            self._unsettled = 0 if settled else self._unsettled + 1
            stubborn = self._unsettled > _SETTLE_PAIRS
        stamp_s = grab.grab_s - age_s
        served = self._room.served(grab.grab_s, stamp_s - 0.5 * pair.exposure_s, settled or stubborn)
        if not served:
            return
        frame = StereoFrame(stamp_s, number, pair.left, pair.right, pair.exposure_s, pair.gain)
        outcome = _stubborn(pair, *asked) if stubborn else frame
        for waiting in served:
            waiting.resolve(outcome)

    def _suffer(self, error: DeviceError) -> None:
        self._room.fail(as_lost(error) if self._pairs else error)


def _with_age(source: OakSource) -> tuple[OakPair, float]:
    pair = source.next_frame()
    return pair, source.age_s(pair)


def _settled(pair: OakPair, exposure_s: float, gain: float) -> bool:
    return math.isclose(pair.exposure_s, exposure_s, rel_tol=_SETTLED) and math.isclose(
        pair.gain, gain, rel_tol=_SETTLED
    )


def _stubborn(pair: OakPair, exposure_s: float, gain: float) -> DeviceFault:
    return DeviceFault(
        "camera", f"exposure {exposure_s:g} s, gain {gain:g}", f"{pair.exposure_s:g} s, {pair.gain:g} by its own word",
        "choose values that this sensor can take",
    )  # fmt: skip


def _closed() -> DeviceLost:
    return DeviceLost("camera", "an open connection", "a closed one", "open the device first")

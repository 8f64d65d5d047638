"""A stereo camera on USB (UVC): one device that gives both views side by side, or two devices.

A device may also be the http address of an MJPEG stream.
"""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from drivers.camera.controls import Control, Controls, Limits, apply
from drivers.camera.grabber import JOIN_S, Grab, Grabber, as_lost
from drivers.camera.pairing import GrabPair, Pairing
from drivers.camera.pictures import Bytes, GarbledError, picture_of
from drivers.camera.stereo_usb_settings import StereoUsbSettings
from drivers.camera.values import Image, StereoFrame
from drivers.camera.video import Video, VideoSettings
from drivers.camera.waiting_room import WaitingRoom
from drivers.errors import DeviceError, DeviceFault, DeviceLost, DeviceMissing, DeviceRefused, DeviceTimeout

OPEN_S = 2.4
HASTY_S = 0.5
LONGEST_CAPTURE_S = 5.0


@dataclass(slots=True)
class CameraStatistics:
    """Pairs seen, and those of the asked-for that were garbled, since the driver was made."""

    pairs: int = 0
    garbled: int = 0


class StereoUsb:
    """Implements ``drivers.camera.interface.StereoCamera``; ``clock`` gives loop time and is read from every thread.

    ``sequence`` numbers the pairs that came, those that nobody asked for included.
    """

    def __init__(self, settings: StereoUsbSettings, clock: Callable[[], float]) -> None:
        self.settings = settings
        self.statistics = CameraStatistics()
        self.pairing = Pairing(settings.pair_apart_s)
        self._clock = clock
        self._grabbers: tuple[Grabber[Video, Bytes], ...] = ()
        self._mutex = threading.Lock()
        self._room = WaitingRoom()
        self._asked = settings.exposure_s, settings.gain
        self._given = self._asked
        self._valid_from = 0
        self._limits: dict[Control, Limits] = {}
        self._is_open = False

    @property
    def image_size(self) -> tuple[int, int]:
        return self.settings.image_size

    async def open(self) -> None:
        self._room.clear()
        self._limits = {}
        self.pairing.forget()
        self._grabbers = tuple(
            Grabber(
                partial(self._open_video, place), Video.next_frame, self._clock, partial(self._take, side), self._suffer
            )
            for side, place in enumerate(self.settings.places)
        )
        waiting = self._room.enter(-np.inf, 0)
        try:
            for grabber in self._grabbers:
                grabber.start()
            if await self._room.wait(waiting, OPEN_S, OPEN_S) is None:
                raise DeviceMissing(
                    "camera", f"a first picture within {OPEN_S:g} s", "none", "check its power and its cable"
                )
            self._is_open = True
        except DeviceLost as error:
            raise DeviceMissing(error.device, error.expected, error.found, error.remedy) from error
        finally:
            self._room.leave(waiting)
            if not self._is_open:
                await self._let_go(HASTY_S)

    async def close(self) -> None:
        await self._let_go(JOIN_S)

    async def _let_go(self, patience_s: float) -> None:
        grabbers, self._grabbers = self._grabbers, ()
        self._is_open = False
        self._room.fail(_closed())
        await asyncio.gather(*(grabber.stop(patience_s) for grabber in grabbers))

    async def capture(self) -> StereoFrame:
        self._require_open()
        if self.pairing.falls_apart:
            raise self._unsynchronised()
        called_s, grabbed = self._clock(), self._grabbed()
        waiting = self._room.enter(called_s, self.settings.in_flight_frames)
        try:
            frame = await self._room.wait(waiting, self.settings.frame_timeout_s, LONGEST_CAPTURE_S)
        finally:
            self._room.leave(waiting)
        if frame is None:
            pairless = all(later > before for later, before in zip(self._grabbed(), grabbed, strict=True))
            raise self._unsynchronised() if pairless else self._silent(self._clock() - called_s)
        return frame

    async def set_exposure(self, exposure_s: float, gain: float) -> None:
        self._require_open()
        if not self.settings.controlled:
            raise DeviceRefused(
                "camera", "a camera with controls", "a bare stream", "set the exposure where the stream is made"
            )
        self._check_bounds(exposure_s, gain)
        before, self._asked = self._asked, (exposure_s, gain)
        jobs = [grabber.post(self._expose_anew) for grabber in self._grabbers]
        try:
            async with asyncio.timeout(LONGEST_CAPTURE_S):
                await asyncio.gather(*(asyncio.wrap_future(job) for job in jobs))
        except TimeoutError as error:
            raise self._silent(LONGEST_CAPTURE_S) from error
        except DeviceFault:
            self._asked = before
            raise
        except DeviceError as error:
            raise as_lost(error) from error

    # --- on the event loop

    def _require_open(self) -> None:
        if not self._is_open:
            raise _closed()

    def _grabbed(self) -> list[int]:
        return [grabber.statistics.frames for grabber in self._grabbers]

    def _check_bounds(self, exposure_s: float, gain: float) -> None:
        scale, limits = self.settings.gain_scale, self._limits
        exposure = limits.get(Control.EXPOSURE_S, Limits(exposure_s, exposure_s, 0.0))
        low_s, high_s = exposure.low, min(exposure.high, 1.0 / self.settings.rate_hz)
        if not low_s <= exposure_s <= high_s:
            raise ValueError(f"exposure: expected {low_s:g} to {high_s:g} s, found {exposure_s:g} s; choose one within")
        numbers = limits.get(Control.GAIN)
        low, high = (1.0, 1.0) if numbers is None else (scale.gain(numbers.low), scale.gain(numbers.high))
        if not max(low, 1.0) <= gain <= high:
            raise ValueError(f"gain: expected {max(low, 1.0):g} to {high:g}, found {gain:g}; choose one within")

    def _silent(self, waited_s: float) -> DeviceTimeout:
        return DeviceTimeout(
            "camera", f"a frame within {self.settings.frame_timeout_s:g} s", f"silence for {waited_s:.1f} s",
            "check its power and its cable",
        )  # fmt: skip

    def _unsynchronised(self) -> DeviceFault:
        return DeviceFault(
            "camera", f"views within {1e3 * self.settings.pair_apart_s:g} ms of each other",
            f"the last ones {1e3 * self.pairing.nearest_miss_s:.0f} ms apart, {self.pairing.dropped} views dropped",
            "use a pair with a common trigger, and give each its own USB controller",
        )  # fmt: skip

    # --- in the owner threads

    def _open_video(self, place: str) -> Video:
        settings = self.settings
        width, height = settings.image_size
        views = 2 if len(settings.places) == 1 else 1
        whole = VideoSettings(
            place, (views * width, height), settings.pixel_format, settings.rate_hz, settings.controlled,
            settings.may_differ,
        )  # fmt: skip
        video = Video(whole, self._wanted)
        with self._mutex:
            if video.controls is not None:
                self._learn(video.controls, video.kept)
            self._settle()
        return video

    def _wanted(self, controls: Controls) -> dict[Control, float]:
        """Every control's value; automatics first, for while they are on what they drive cannot be set."""
        settings = self.settings
        wanted: dict[Control, float] = {
            Control.AUTO_FOCUS: 0.0,
            Control.AUTO_RATE: 0.0,
            Control.AUTO_EXPOSURE: 0.0,
            Control.AUTO_WHITE_BALANCE: 0.0,
        }
        if settings.power_line_hz is not None:
            wanted[Control.POWER_LINE_HZ] = settings.power_line_hz
        if settings.white_balance_k is not None:
            wanted[Control.WHITE_BALANCE_K] = settings.white_balance_k
        return wanted | self._exposure_controls(controls)

    def _exposure_controls(self, controls: Controls) -> dict[Control, float]:
        """A camera without a gain has the gain 1."""
        exposure_s, gain = self._asked
        wanted = {Control.EXPOSURE_S: exposure_s}
        if gain != 1.0 or controls.limits(Control.GAIN) is not None:
            wanted[Control.GAIN] = self.settings.gain_scale.number(gain)
        return wanted

    def _expose_anew(self, video: Video) -> None:
        if video.controls is None:
            return
        kept = apply(video.controls, self._exposure_controls(video.controls), self.settings.may_differ)
        with self._mutex:
            self._learn(video.controls, kept)
            self._settle()

    def _learn(self, controls: Controls, kept: dict[Control, float]) -> None:
        for control in (Control.EXPOSURE_S, Control.GAIN):
            if control not in self._limits and (limits := controls.limits(control)) is not None:
                self._limits[control] = limits
        exposure_s = kept.get(Control.EXPOSURE_S, self._asked[0])
        gain = self.settings.gain_scale.gain(kept[Control.GAIN]) if Control.GAIN in kept else 1.0
        self._given = exposure_s, gain

    def _settle(self) -> None:
        settings = self.settings
        self._valid_from = self.statistics.pairs + 1 + settings.in_flight_frames + settings.settle_frames

    def _take(self, side: int, grab: Grab[Bytes]) -> None:
        with self._mutex:
            pair = GrabPair(grab) if len(self.settings.places) == 1 else self.pairing.add(side, grab)
            if pair is None:
                return
            self.statistics.pairs += 1
            number, given = self.statistics.pairs, self._given
            valid = number >= self._valid_from
        begin_s = pair.grab_s - self.settings.latency_s - given[0]
        if served := self._room.served(pair.grab_s, begin_s, valid):
            outcome = self._develop(pair, number, *given)
            for waiting in served:
                waiting.resolve(outcome)

    def _develop(self, pair: GrabPair, number: int, exposure_s: float, gain: float) -> StereoFrame | DeviceError:
        settings = self.settings
        width, height = settings.image_size
        try:
            if pair.right is None:
                whole = picture_of(pair.left.data, settings.pixel_format, (2 * width, height))
                left, right = np.ascontiguousarray(whole[:, :width]), np.ascontiguousarray(whole[:, width:])
            else:
                left, right = (
                    picture_of(grab.data, settings.pixel_format, (width, height)) for grab in (pair.left, pair.right)
                )
        except GarbledError as error:
            self.statistics.garbled += 1
            return DeviceFault(
                "camera", "a whole frame", f"a garbled one: {error}",
                "check the cable, and that no other camera shares its USB controller",
            )  # fmt: skip
        views: tuple[Image, Image] = (right, left) if settings.swapped else (left, right)
        stamp_s = pair.grab_s - settings.latency_s - 0.5 * exposure_s
        return StereoFrame(stamp_s, number, *views, exposure_s, gain)

    def _suffer(self, error: DeviceError) -> None:
        self._room.fail(as_lost(error) if self._is_open else error)


def _closed() -> DeviceLost:
    return DeviceLost("camera", "an open connection", "a closed one", "open the device first")

"""A stereo camera on USB (UVC): one device that gives both views side by side, or two devices.

A device may also be the http address of an MJPEG stream.
"""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field

import numpy as np

from drivers.camera.controls import Control, Controls, GainScale, Limits, apply
from drivers.camera.grabber import Grab, Grabber, as_lost
from drivers.camera.pairing import GrabPair, Pairing
from drivers.camera.pictures import GarbledError, PixelFormat, picture_of
from drivers.camera.values import Image, StereoFrame
from drivers.camera.video import Video, VideoSettings
from drivers.errors import DeviceError, DeviceFault, DeviceLost, DeviceMissing, DeviceRefused, DeviceTimeout

OPEN_S = 2.5
LONGEST_CAPTURE_S = 5.0


@dataclass(frozen=True, slots=True)
class StereoUsbSettings:
    """``places``: one side-by-side device, or the left and the right one. ``image_size`` (width, height) of each view.

    ``latency_s`` is from the end of an exposure to its grab (readout and transfer; the test card measures it). At least
    ``in_flight_frames`` that arrive after a call are discarded, as they may have been exposed before it, and
    ``settle_frames`` more after the controls changed. Two devices' frames make a pair when they arrive within
    ``pair_apart_s``. ``swapped``: the side-by-side picture has the right view on its left. ``white_balance_k`` and
    ``power_line_hz`` None are left as they are. ``may_differ``: controls that need not keep their value. ``controlled``
    False: a bare stream, whose exposure is as given here and fixed.
    """

    places: tuple[str, ...]
    image_size: tuple[int, int]
    exposure_s: float
    gain: float = 1.0
    pixel_format: PixelFormat = "MJPG"
    rate_hz: float = 15.0
    white_balance_k: float | None = None
    power_line_hz: int | None = 50
    gain_scale: GainScale = field(default_factory=GainScale)
    latency_s: float = 0.03
    in_flight_frames: int = 1
    settle_frames: int = 2
    pair_apart_s: float = 0.010
    frame_timeout_s: float = 0.5
    swapped: bool = False
    controlled: bool = True
    may_differ: frozenset[Control] = field(default_factory=frozenset)

    def __post_init__(self) -> None:
        if len(self.places) not in (1, 2) or len(set(self.places)) != len(self.places):
            raise ValueError(f"places: expected one device or two different ones, found {self.places}; name them")
        if self.in_flight_frames < 1:
            raise ValueError(f"in_flight_frames: expected at least 1, found {self.in_flight_frames}; one is always")


@dataclass(slots=True)
class CameraStatistics:
    """Pairs seen, and those of the asked-for that were garbled, since the driver was made."""

    pairs: int = 0
    garbled: int = 0


@dataclass(eq=False, slots=True)
class _Waiting:
    """Someone who waits for a pair exposed after ``after_s``, with ``discard`` pairs yet to let pass."""

    after_s: float
    discard: int
    loop: asyncio.AbstractEventLoop
    future: asyncio.Future[StereoFrame]

    def resolve(self, outcome: StereoFrame | DeviceError) -> None:
        """From any thread."""
        with suppress(RuntimeError):  # the loop has ended, and with it whoever waited
            self.loop.call_soon_threadsafe(_resolve, self.future, outcome)


def _resolve(future: asyncio.Future[StereoFrame], outcome: StereoFrame | DeviceError) -> None:
    if future.done():
        return
    if isinstance(outcome, DeviceError):
        future.set_exception(outcome)
    else:
        future.set_result(outcome)


class StereoUsb:
    """Implements ``drivers.camera.interface.StereoCamera``; ``clock`` gives loop time and is read from every thread.

    ``sequence`` numbers the pairs that came, those that nobody asked for included.
    """

    def __init__(self, settings: StereoUsbSettings, clock: Callable[[], float]) -> None:
        self.settings = settings
        self.statistics = CameraStatistics()
        self.pairing = Pairing(settings.pair_apart_s)
        self._clock = clock
        self._grabbers: tuple[Grabber, ...] = ()
        self._mutex = threading.RLock()
        self._waiting: list[_Waiting] = []
        self._trouble: DeviceError | None = None
        self._asked = settings.exposure_s, settings.gain
        self._given = self._asked
        self._valid_from = 0
        self._limits: dict[Control, Limits] = {}
        self._is_open = False

    @property
    def image_size(self) -> tuple[int, int]:
        return self.settings.image_size

    async def open(self) -> None:
        self._trouble = None
        self._limits = {}
        self.pairing.forget()
        self._grabbers = tuple(
            Grabber(
                lambda place=place: self._open_video(place),  # type: ignore[misc]  # bound now
                self._clock,
                lambda grab, side=side: self._take(side, grab),  # type: ignore[misc]
                self._suffer,
            )
            for side, place in enumerate(self.settings.places)
        )
        try:
            waiting = self._wait_for(-np.inf, 0)
            for grabber in self._grabbers:
                grabber.start()
            async with asyncio.timeout(OPEN_S):
                await waiting.future
            self._is_open = True
        except TimeoutError as error:
            await self.close()
            raise DeviceMissing(
                "camera", f"a first picture within {OPEN_S:g} s", "silence", "check its power and its cable"
            ) from error
        except DeviceLost as error:
            await self.close()
            raise DeviceMissing(error.device, error.expected, error.found, error.remedy) from error
        except BaseException:
            await self.close()
            raise

    async def close(self) -> None:
        grabbers, self._grabbers = self._grabbers, ()
        self._is_open = False
        self._suffer(_closed())
        await asyncio.gather(*(grabber.stop() for grabber in grabbers))

    async def capture(self) -> StereoFrame:
        self._require_open()
        called_s = self._clock()
        waiting = self._wait_for(called_s, self.settings.in_flight_frames)
        try:
            return await self._patiently(waiting, called_s)
        finally:
            self._wait_no_more(waiting)

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

    def _wait_for(self, after_s: float, discard: int) -> _Waiting:
        loop = asyncio.get_running_loop()
        waiting = _Waiting(after_s, discard, loop, loop.create_future())
        with self._mutex:
            self._waiting.append(waiting)
            if self._trouble is not None and not isinstance(self._trouble, DeviceTimeout):
                waiting.resolve(self._trouble)
        return waiting

    def _wait_no_more(self, waiting: _Waiting) -> None:
        with self._mutex:
            if waiting in self._waiting:
                self._waiting.remove(waiting)
        waiting.future.cancel()

    async def _patiently(self, waiting: _Waiting, called_s: float) -> StereoFrame:
        """Wait as long as frames come; ``DeviceTimeout`` when none has come for ``frame_timeout_s``."""
        patience_s = self.settings.frame_timeout_s
        while True:
            seen = self.statistics.pairs
            done, _ = await asyncio.wait({waiting.future}, timeout=patience_s)
            if done:
                return waiting.future.result()
            if self.pairing.falls_apart:
                raise self._unsynchronised()
            waited_s = self._clock() - called_s
            if self.statistics.pairs == seen or waited_s > LONGEST_CAPTURE_S:
                raise self._silent(waited_s)

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

    def _take(self, side: int, grab: Grab) -> None:
        with self._mutex:
            pair = GrabPair(grab) if len(self.settings.places) == 1 else self.pairing.add(side, grab)
            if pair is None:
                return
            self._trouble = None
            self.statistics.pairs += 1
            served = [waiting for waiting in self._waiting if self._serves(waiting, pair)]
            self._waiting = [waiting for waiting in self._waiting if waiting not in served]
            number, given = self.statistics.pairs, self._given
        if served:
            outcome = self._develop(pair, number, *given)
            for waiting in served:
                waiting.resolve(outcome)

    def _serves(self, waiting: _Waiting, pair: GrabPair) -> bool:
        """Whether the pair was exposed after the call, by its place in the stream and by the clock."""
        if waiting.discard > 0:
            waiting.discard -= pair.grab_s > waiting.after_s
            return False
        begin_s = pair.grab_s - self.settings.latency_s - self._given[0]
        return begin_s >= waiting.after_s and self.statistics.pairs >= self._valid_from

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
        with self._mutex:
            self._trouble = as_lost(error) if self._is_open else error
            if isinstance(error, DeviceTimeout):
                return
            served, self._waiting = self._waiting, []
            trouble = self._trouble
        for waiting in served:
            waiting.resolve(trouble)


def _closed() -> DeviceLost:
    return DeviceLost("camera", "an open connection", "a closed one", "open the device first")

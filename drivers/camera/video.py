"""An open video device or stream, as its owner thread sees it: frames as bytes, and the controls beside them."""

from __future__ import annotations

import time
import urllib.error
import urllib.request
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import cv2
import numpy as np

from drivers.camera.controls import Control, Controls, apply
from drivers.camera.http_controls import HttpControls
from drivers.camera.pictures import Bytes, PixelFormat
from drivers.camera.v4l2 import V4l2Device
from drivers.errors import DeviceError, DeviceFault, DeviceLost, DeviceMissing, DeviceTimeout, WrongDevice

OPEN_TIMEOUT_S = 1.5
READ_TIMEOUT_S = 1.0
_LOOK_TIMEOUT_S = 0.5
_RATE_TOLERANCE = 0.05
_BUFFERS = 2


@dataclass(frozen=True, slots=True)
class VideoSettings:
    """``place``: a path under /dev, or the http address of an MJPEG stream. ``size`` (width, height) of whole frames.

    ``controlled``: whether it has controls to set; a bare stream has none.
    """

    place: str
    size: tuple[int, int]
    pixel_format: PixelFormat = "MJPG"
    rate_hz: float = 15.0
    controlled: bool = True
    may_differ: frozenset[Control] = field(default_factory=frozenset)

    @property
    def is_address(self) -> bool:
        return self.place.startswith(("http://", "https://"))


Wanted = Callable[[Controls], Mapping[Control, float]]


class Video:
    """Belongs to one thread. Opening ends with the first frame seen and every control set and verified.

    ``wanted`` tells what the controls are to be, in order.

    Raises ``DeviceMissing``, ``DeviceBusy``, ``WrongDevice`` (size, format, or no camera at all), ``DeviceFault`` (a
    control does not keep its value).
    """

    def __init__(self, settings: VideoSettings, wanted: Wanted) -> None:
        self.settings = settings
        self.controls: Controls | None = None
        self.kept: dict[Control, float] = {}
        self._capture: cv2.VideoCapture | None = None
        try:
            self.controls = self._open()
            self.next_frame()
            if self.controls is not None:
                self.kept = apply(self.controls, wanted(self.controls), settings.may_differ)
        except OSError as error:
            self.close()
            raise self._missing(error.strerror or str(error)) from error
        except DeviceTimeout as error:
            self.close()
            raise self._missing("silence") from error
        except BaseException:
            self.close()
            raise

    def _missing(self, found: str) -> DeviceMissing:
        return DeviceMissing(
            "camera", f"pictures from {self.settings.place}", found, "check that it is plugged in and has its power"
        )

    def close(self) -> None:
        if self._capture is not None:
            self._capture.release()
            self._capture = None
        if self.controls is not None:
            self.controls.close()

    def next_frame(self) -> Bytes:
        """The bytes of the next frame. ``DeviceLost`` when the device has gone, ``DeviceTimeout`` when it is silent."""
        assert self._capture is not None
        began_s = time.monotonic()
        if not self._capture.grab():
            place, waited_s = self.settings.place, time.monotonic() - began_s
            if waited_s < 0.9 * READ_TIMEOUT_S:
                raise DeviceLost("camera", f"{place} to be there", "it gone", "plug it in again; it is looked for")
            raise DeviceTimeout(
                "camera", f"a frame from {place}", f"silence for {waited_s:.1f} s", "check its cable and its power"
            )
        took, data = self._capture.retrieve()
        return np.ascontiguousarray(data, dtype=np.uint8) if took and data is not None else np.empty(0, np.uint8)

    def _open(self) -> Controls | None:
        settings = self.settings
        controls: Controls | None = None
        if settings.is_address:
            if settings.controlled:
                controls = HttpControls(settings.place)
            self._capture = _open_stream(settings)
        else:
            controls = device = V4l2Device(settings.place)
            try:
                device.ask_format(*settings.size, settings.pixel_format)
                self._capture = _open_node(settings)
            except BaseException:
                device.close()
                raise
        found = round(self._capture.get(cv2.CAP_PROP_FRAME_WIDTH)), round(self._capture.get(cv2.CAP_PROP_FRAME_HEIGHT))
        if found != settings.size:
            (wide, high), (width, height) = found, settings.size
            raise WrongDevice(
                "camera", f"pictures of {width}x{height}", f"{wide}x{high} from {settings.place}",
                "correct image_size_px (one view), or name the right camera",
            )  # fmt: skip
        return controls


def _open_stream(settings: VideoSettings) -> cv2.VideoCapture:
    options = [
        cv2.CAP_PROP_OPEN_TIMEOUT_MSEC, int(1e3 * OPEN_TIMEOUT_S),
        cv2.CAP_PROP_READ_TIMEOUT_MSEC, int(1e3 * READ_TIMEOUT_S),
        cv2.CAP_PROP_FORMAT, -1,  # frames as they come, not decoded
    ]  # fmt: skip
    capture = cv2.VideoCapture(settings.place, cv2.CAP_FFMPEG, options)
    if not capture.isOpened():
        capture.release()
        raise _why_not(settings.place)
    return capture


def _why_not(address: str) -> DeviceError:
    """What an address answers that gives no video."""
    opener = urllib.request.build_opener(urllib.request.ProxyHandler({}))
    try:
        with opener.open(address, timeout=_LOOK_TIMEOUT_S) as answer:
            kind = answer.headers.get_content_type()
    except urllib.error.HTTPError as error:
        with error:
            return WrongDevice("camera", f"a stream at {address}", f"HTTP {error.code}", "correct the address")
    except (OSError, ValueError) as error:
        found = "silence" if isinstance(error, TimeoutError) else f"nothing there ({getattr(error, 'reason', error)})"
        return DeviceMissing("camera", f"a stream at {address}", found, "check the camera's power, or the address")
    if kind.startswith(("multipart/", "video/")):
        return DeviceMissing("camera", f"a picture from {address}", f"none ({kind})", "check the camera")
    return WrongDevice("camera", f"an MJPEG stream at {address}", f"{kind}", "correct the address")


def _open_node(settings: VideoSettings) -> cv2.VideoCapture:
    capture = cv2.VideoCapture(settings.place, cv2.CAP_V4L2)
    if not capture.isOpened():
        capture.release()
        raise DeviceMissing("camera", f"{settings.place} to stream", "refusal", "unplug it and plug it in again")
    width, height = settings.size
    fourcc = cv2.VideoWriter.fourcc(*settings.pixel_format)
    capture.set(cv2.CAP_PROP_BUFFERSIZE, _BUFFERS)
    capture.set(cv2.CAP_PROP_FOURCC, fourcc)
    capture.set(cv2.CAP_PROP_FRAME_WIDTH, width)
    capture.set(cv2.CAP_PROP_FRAME_HEIGHT, height)
    capture.set(cv2.CAP_PROP_FPS, settings.rate_hz)
    capture.set(cv2.CAP_PROP_CONVERT_RGB, 0)  # frames as they come, not decoded
    found_code, rate_hz = round(capture.get(cv2.CAP_PROP_FOURCC)), capture.get(cv2.CAP_PROP_FPS)
    trouble: DeviceError | None = None
    if found_code != fourcc:
        given = found_code.to_bytes(4, "little").decode("ascii", "replace")
        trouble = WrongDevice(
            "camera", f"pictures in {settings.pixel_format}", given, "choose one that v4l2-ctl --list-formats shows"
        )
    elif abs(rate_hz - settings.rate_hz) > _RATE_TOLERANCE * settings.rate_hz:
        trouble = DeviceFault(
            "camera", f"{settings.rate_hz:g} pictures a second", f"{rate_hz:g}",
            "choose a rate that v4l2-ctl --list-formats-ext shows for this size",
        )  # fmt: skip
    if trouble is not None:
        capture.release()
        raise trouble
    return capture

"""Video4Linux2 by its ioctls: what a device is, whether it is free, and its controls.

Numbers and layouts after linux/videodev2.h and linux/v4l2-controls.h (64 bit).
"""

from __future__ import annotations

import errno
import fcntl
import os
import struct
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from drivers.camera.controls import Control, Limits
from drivers.errors import DeviceBusy, DeviceFault, DeviceMissing, WrongDevice

# request, buffer in and out; raises OSError
Ioctl = Callable[[int, int, bytearray], int]

VIDIOC_QUERYCAP = 0x80685600
VIDIOC_G_FMT = 0xC0D05604
VIDIOC_S_FMT = 0xC0D05605
VIDIOC_G_CTRL = 0xC008561B
VIDIOC_S_CTRL = 0xC008561C
VIDIOC_QUERYCTRL = 0xC0445624

CAPABILITY = struct.Struct("=16s32s32s6I")
CONTROL = struct.Struct("=Ii")
QUERY = struct.Struct("=II32s4iI8x")
PICTURE_FORMAT = struct.Struct("=I4x3I")  # type, width, height, pixel format; the rest is the driver's
FORMAT_SIZE = 208

_CAPTURES, _STREAMS, _DEVICE_CAPS = 0x00000001, 0x04000000, 0x80000000
_DISABLED, _READ_ONLY, _INACTIVE = 0x0001, 0x0004, 0x0010
_VIDEO_CAPTURE = 1
_EXPOSURE_UNIT_S = 0.0001
_MANUAL_EXPOSURE, _APERTURE_PRIORITY = 1, 3
_LINE_HZ = (0, 50, 60)  # the menu of V4L2_CID_POWER_LINE_FREQUENCY

IDS: Mapping[Control, int] = {
    Control.GAIN: 0x00980913,
    Control.AUTO_WHITE_BALANCE: 0x0098090C,
    Control.POWER_LINE_HZ: 0x00980918,
    Control.WHITE_BALANCE_K: 0x0098091A,
    Control.AUTO_EXPOSURE: 0x009A0901,
    Control.EXPOSURE_S: 0x009A0902,
    Control.AUTO_RATE: 0x009A0903,
    Control.AUTO_FOCUS: 0x009A090C,
}


@dataclass(frozen=True, slots=True)
class Identity:
    """What a device says it is."""

    driver: str
    card: str
    bus: str


def _system_ioctl(descriptor: int, request: int, buffer: bytearray) -> int:
    return int(fcntl.ioctl(descriptor, request, buffer, True))


class V4l2Device:
    """An open video node beside the one that streams: V4L2 lets any handle read and set controls.

    ``DeviceMissing`` when the path is not there or may not be opened, ``WrongDevice`` when it is no capture device.
    """

    def __init__(self, path: str, ioctl: Ioctl = _system_ioctl) -> None:
        self._path, self._ioctl = path, ioctl
        try:
            self._descriptor = os.open(path, os.O_RDWR | os.O_NONBLOCK | os.O_CLOEXEC)
        except PermissionError as error:
            raise DeviceMissing(
                "camera", f"{path} to be open to this user", "permission denied", "add the user to the group video"
            ) from error
        except OSError as error:
            raise DeviceMissing(
                "camera", f"{path}", error.strerror or "nothing there", "plug it in; ls /dev/v4l/by-id shows what is"
            ) from error
        try:
            self.identity = self._identify()
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        if self._descriptor >= 0:
            os.close(self._descriptor)
            self._descriptor = -1

    def _call(self, request: int, buffer: bytearray) -> None:
        self._ioctl(self._descriptor, request, buffer)

    def _identify(self) -> Identity:
        buffer = bytearray(CAPABILITY.size)
        try:
            self._call(VIDIOC_QUERYCAP, buffer)
        except OSError as error:
            raise WrongDevice(
                "camera", f"{self._path} to be a video device", "something else", "name the camera's own node"
            ) from error
        driver, card, bus, _, able, able_node, *_ = CAPABILITY.unpack(buffer)
        identity = Identity(_text(driver), _text(card), _text(bus))
        able = able_node if able & _DEVICE_CAPS else able
        if not (able & _CAPTURES and able & _STREAMS):
            raise WrongDevice(
                "camera", f"{self._path} to give pictures", f"a node of {identity.card} that does not",
                "name the camera's first node (its by-id name ends in video-index0)",
            )  # fmt: skip
        return identity

    def ask_format(self, width: int, height: int, fourcc: str) -> None:
        """Ask for size and format; raises ``DeviceBusy`` naming the holder, ``WrongDevice`` naming what it gives."""
        buffer = bytearray(FORMAT_SIZE)
        PICTURE_FORMAT.pack_into(buffer, 0, _VIDEO_CAPTURE, width, height, int.from_bytes(fourcc.encode(), "little"))
        try:
            self._call(VIDIOC_S_FMT, buffer)
        except OSError as error:
            if error.errno == errno.EBUSY:
                raise DeviceBusy(
                    "camera", f"{self._path} to be free", f"it held by {holder(self._path)}", "end that program"
                ) from error
            raise DeviceFault(
                "camera", f"{width}x{height} {fourcc}", f"refusal ({error.strerror})", "v4l2-ctl --list-formats-ext"
            ) from error
        _, wide, high, code = PICTURE_FORMAT.unpack_from(buffer, 0)
        given = code.to_bytes(4, "little").decode("ascii", "replace")
        if (wide, high, given) != (width, height, fourcc):
            raise WrongDevice(
                "camera", f"pictures of {width}x{height} {fourcc}", f"{wide}x{high} {given} from {self.identity.card}",
                "correct image size and format (v4l2-ctl --list-formats-ext), or name the right camera",
            )  # fmt: skip

    # --- Controls

    def limits(self, control: Control) -> Limits | None:
        found = self._query(control)
        if found is None:
            return None
        low, high, step, flags = found
        if flags & _DISABLED:
            return None
        match control:
            case Control.EXPOSURE_S:
                return Limits(low * _EXPOSURE_UNIT_S, high * _EXPOSURE_UNIT_S, max(step, 1) * _EXPOSURE_UNIT_S)
            case Control.POWER_LINE_HZ:
                return Limits(0.0, float(_LINE_HZ[min(high, 2)]), 10.0)
            case Control.AUTO_EXPOSURE:
                return Limits(0.0, 1.0, 1.0)
        return Limits(float(low), float(high), float(max(step, 1)))

    def read(self, control: Control) -> float:
        buffer = bytearray(CONTROL.pack(IDS[control], 0))
        self._control_call(VIDIOC_G_CTRL, control, buffer)
        return _from_device(control, CONTROL.unpack(buffer)[1])

    def write(self, control: Control, value: float) -> None:
        buffer = bytearray(CONTROL.pack(IDS[control], _to_device(control, value)))
        self._control_call(VIDIOC_S_CTRL, control, buffer)

    def _query(self, control: Control) -> tuple[int, int, int, int] | None:
        buffer = bytearray(QUERY.size)
        struct.pack_into("=I", buffer, 0, IDS[control])
        try:
            self._call(VIDIOC_QUERYCTRL, buffer)
        except OSError as error:
            if error.errno in (errno.EINVAL, errno.ENOTTY):
                return None
            raise
        _, _, _, low, high, step, _, flags = QUERY.unpack(buffer)
        return low, high, step, flags

    def _control_call(self, request: int, control: Control, buffer: bytearray) -> None:
        try:
            self._call(request, buffer)
        except OSError as error:
            if error.errno == errno.ENODEV:
                raise
            found = self._query(control)
            flags = 0 if found is None else found[3]
            why = "it is read-only" if flags & _READ_ONLY else "an automatic drives it" if flags & _INACTIVE else ""
            raise DeviceFault(
                "camera", f"{control} to be set", why or f"refusal ({error.strerror})",
                "switch off its automatic, or allow it to differ; v4l2-ctl --list-ctrls shows all",
            ) from error  # fmt: skip


def holder(path: str, proc: str = "/proc") -> str:
    """Which process has a device node open, for a person: ``guvcview (PID 812)``."""
    target = os.path.realpath(path)
    for pid in filter(str.isdigit, os.listdir(proc)):
        if int(pid) == os.getpid():
            continue
        try:
            links = [os.path.realpath(f"{proc}/{pid}/fd/{name}") for name in os.listdir(f"{proc}/{pid}/fd")]
            if target in links:
                with open(f"{proc}/{pid}/comm", encoding="utf-8") as comm:
                    return f"{comm.read().strip()} (PID {pid})"
        except OSError:
            continue  # it has ended meanwhile, or belongs to another user
    return "another program"


def _to_device(control: Control, value: float) -> int:
    match control:
        case Control.EXPOSURE_S:
            return round(value / _EXPOSURE_UNIT_S)
        case Control.AUTO_EXPOSURE:
            return _APERTURE_PRIORITY if value else _MANUAL_EXPOSURE
        case Control.POWER_LINE_HZ:
            return _LINE_HZ.index(round(value))
    return round(value)


def _from_device(control: Control, number: int) -> float:
    match control:
        case Control.EXPOSURE_S:
            return number / round(1.0 / _EXPOSURE_UNIT_S)
        case Control.AUTO_EXPOSURE:
            return float(number != _MANUAL_EXPOSURE)
        case Control.POWER_LINE_HZ:
            return float(_LINE_HZ[number]) if 0 <= number < len(_LINE_HZ) else -1.0
    return float(number)


def _text(field: bytes) -> str:
    return field.split(b"\0")[0].decode("ascii", "replace")

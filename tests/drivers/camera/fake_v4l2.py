"""A video node as its kernel driver behaves: capabilities, formats, controls with limits, steps and flags."""

from __future__ import annotations

import errno
from dataclasses import dataclass, field

from drivers.camera import v4l2

_NUMBERS = {number: name for name, number in v4l2.IDS.items()}


@dataclass
class NodeControl:
    """A control in the driver's own numbers. ``driven_by``: inactive while that control has not the value given."""

    low: int
    high: int
    step: int
    value: int
    menu: tuple[int, ...] = ()
    driven_by: tuple[v4l2.Control, int] | None = None
    read_only: bool = False
    disabled: bool = False
    forgets: bool = False


@dataclass
class Node:
    """What uvcvideo answers for one camera; ``ioctl`` is what ``V4l2Device`` calls."""

    controls: dict[v4l2.Control, NodeControl]
    formats: dict[str, tuple[tuple[int, int], ...]] = field(
        default_factory=lambda: {"MJPG": ((1280, 480), (2560, 720)), "YUYV": ((1280, 480),)}
    )
    captures: bool = True
    video: bool = True
    streaming_elsewhere: bool = False
    gone: bool = False
    set_format: tuple[int, int, str] | None = None
    calls: list[int] = field(default_factory=list)

    @classmethod
    def at_power_on(cls) -> Node:
        c = v4l2.Control
        return cls(
            {
                c.GAIN: NodeControl(0, 100, 1, 0),
                c.AUTO_WHITE_BALANCE: NodeControl(0, 1, 1, 1),
                c.WHITE_BALANCE_K: NodeControl(2800, 6500, 10, 4600, driven_by=(c.AUTO_WHITE_BALANCE, 0)),
                c.POWER_LINE_HZ: NodeControl(0, 2, 1, 2, menu=(0, 1, 2)),
                c.AUTO_EXPOSURE: NodeControl(0, 3, 1, 3, menu=(1, 3)),
                c.EXPOSURE_S: NodeControl(1, 5000, 1, 157, driven_by=(c.AUTO_EXPOSURE, 1)),
                c.AUTO_RATE: NodeControl(0, 1, 1, 1),
            }
        )

    def ioctl(self, descriptor: int, request: int, buffer: bytearray) -> int:
        self.calls.append(request)
        if self.gone:
            raise OSError(errno.ENODEV, "No such device")
        if not self.video:
            raise OSError(errno.ENOTTY, "Inappropriate ioctl for device")
        match request:
            case v4l2.VIDIOC_QUERYCAP:
                able = 0x85200001 if self.captures else 0x84A00000
                node = 0x04200001 if self.captures else 0x04A00000
                v4l2.CAPABILITY.pack_into(buffer, 0, b"uvcvideo", b"Stereo Cam", b"usb-1.2", 6, able, node, 0, 0, 0)
            case v4l2.VIDIOC_S_FMT:
                self._take_format(buffer)
            case v4l2.VIDIOC_QUERYCTRL:
                self._describe(buffer)
            case v4l2.VIDIOC_G_CTRL:
                number, _ = v4l2.CONTROL.unpack(buffer)
                buffer[:] = v4l2.CONTROL.pack(number, self._control(number).value)
            case v4l2.VIDIOC_S_CTRL:
                self._set(*v4l2.CONTROL.unpack(buffer))
            case _:
                raise OSError(errno.ENOTTY, "Inappropriate ioctl for device")
        return 0

    def _control(self, number: int) -> NodeControl:
        control = self.controls.get(_NUMBERS[number]) if number in _NUMBERS else None
        if control is None:
            raise OSError(errno.EINVAL, "Invalid argument")
        return control

    def _inactive(self, control: NodeControl) -> bool:
        return control.driven_by is not None and self.controls[control.driven_by[0]].value != control.driven_by[1]

    def _describe(self, buffer: bytearray) -> None:
        number = int.from_bytes(buffer[:4], "little")
        control = self._control(number)
        flags = control.disabled * 1 + control.read_only * 4 + self._inactive(control) * 16
        v4l2.QUERY.pack_into(
            buffer, 0, number, 1, b"some control", control.low, control.high, control.step, control.low, flags
        )

    def _set(self, number: int, value: int) -> None:
        control = self._control(number)
        if control.read_only:
            raise OSError(errno.EACCES, "Permission denied")
        if self._inactive(control):
            raise OSError(errno.EIO, "Input/output error")
        if control.menu and value not in control.menu:
            raise OSError(errno.EINVAL, "Invalid argument")
        if not control.forgets:
            steps = round((min(max(value, control.low), control.high) - control.low) / control.step)
            control.value = control.low + steps * control.step

    def _take_format(self, buffer: bytearray) -> None:
        if self.streaming_elsewhere:
            raise OSError(errno.EBUSY, "Device or resource busy")
        _, width, height, code = v4l2.PICTURE_FORMAT.unpack_from(buffer, 0)
        fourcc = code.to_bytes(4, "little").decode()
        fourcc = fourcc if fourcc in self.formats else next(iter(self.formats))
        wide, high = min(self.formats[fourcc], key=lambda size: abs(size[0] - width) + abs(size[1] - height))
        self.set_format = wide, high, fourcc
        v4l2.PICTURE_FORMAT.pack_into(buffer, 0, 1, wide, high, int.from_bytes(fourcc.encode(), "little"))

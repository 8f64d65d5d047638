"""An open serial device or TCP connection, as its owner thread sees it: blocking reads and writes with deadlines."""

from __future__ import annotations

import errno
import os
import select
import socket
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import Literal

import serial

from drivers import port_lock
from drivers.byte_trace import Direction
from drivers.errors import DeviceMissing, DeviceTimeout

READ_BYTES = 4096
WRITE_TIMEOUT_S = 1.0
CONNECT_TIMEOUT_S = 1.5
UNHEARD_MS = 2000  # a TCP peer that acknowledges nothing for so long is gone

TCP = "tcp://"
RTU_TCP = "rtu+tcp://"

Parity = Literal["N", "E", "O"]


@dataclass(frozen=True, slots=True)
class PortSettings:
    """Where a device is and how it speaks. ``path`` is a stable name (``/dev/serial/by-id/...``).

    A path ``tcp://host:port`` or ``rtu+tcp://host:port`` is a TCP connection instead; ``baud`` is then that of the
    serial line behind the gateway, 0 when there is none. ``protocol`` names the decoder of the port's byte trace;
    ``device`` stands first in error messages.
    """

    path: str
    device: str
    baud: int
    protocol: str
    parity: Parity = "N"
    stop_bits: Literal[1, 2] = 1

    @property
    def byte_s(self) -> float:
        """How long one byte takes on the wire, 0 without a serial line."""
        return (9 + (self.parity != "N") + self.stop_bits) / self.baud if self.baud else 0.0

    @property
    def is_tcp(self) -> bool:
        return self.path.startswith((TCP, RTU_TCP))


class Line:
    """Belongs to one thread. Every method raises ``OSError`` when the device is gone.

    ``keep`` is told of every chunk that goes out or comes in.
    """

    def __init__(self, settings: PortSettings, keep: Callable[[Direction, bytes], None]) -> None:
        """Open, lock and set. ``DeviceMissing``, ``DeviceBusy``. A TCP connection is the device's own to lock."""
        self.settings = settings
        self._keep = keep
        self._held = b""
        self._device: serial.Serial | socket.socket
        if settings.is_tcp:
            self._device = _connect(settings)
            return
        self._device = _open(settings)
        try:
            port_lock.take(self.descriptor, settings.device, settings.path)
        except BaseException:
            self._device.close()
            raise
        with suppress(OSError, ValueError, NotImplementedError):  # only USB adapters have a latency timer
            self._device.set_low_latency_mode(True)

    @property
    def descriptor(self) -> int:
        return int(self._device.fileno())

    def close(self) -> None:
        if not self.settings.is_tcp:
            port_lock.release(self.settings.path)
        with suppress(OSError):
            self._device.close()

    def set_baud(self, baud: int) -> None:
        """Another rate on the same open device, for searching; a gateway keeps its own."""
        if not isinstance(self._device, socket.socket):
            self._device.baudrate = baud

    def write(self, data: bytes, timeout_s: float = WRITE_TIMEOUT_S) -> None:
        """All of ``data``, or ``DeviceTimeout``."""
        write_all(self.descriptor, data, timeout_s, self.settings.device)
        self._keep("out", data)

    def read(self, size: int, timeout_s: float) -> bytes:
        """``size`` bytes, or fewer when the time is over."""
        deadline_s = time.monotonic() + timeout_s
        while len(self._held) < size and self._fill(deadline_s - time.monotonic()):
            pass
        data, self._held = self._held[:size], self._held[size:]
        return data

    def read_some(self, timeout_s: float) -> bytes:
        """What is there, at most ``READ_BYTES``; waits for the first byte, b"" when none comes in time."""
        if not self._held:
            self._fill(timeout_s)
        data, self._held = self._held, b""
        return data

    def waiting(self) -> int:
        """Bytes that can be read without waiting."""
        self._fill(0.0)
        return len(self._held)

    def drain(self, silence_s: float = 0.0, longest_s: float = 0.5) -> bytes:
        """Throw away input until the line has been silent for ``silence_s``; returns the last of what was thrown."""
        deadline_s = time.monotonic() + longest_s
        thrown = b""
        while time.monotonic() < deadline_s and (data := self.read_some(silence_s)):
            thrown = data
        return thrown

    def _fill(self, timeout_s: float) -> bool:
        """Read what is there after waiting for it; False when nothing came."""
        if not select.select([self.descriptor], [], [], max(0.0, timeout_s))[0]:
            return False
        try:
            data = os.read(self.descriptor, READ_BYTES)
        except BlockingIOError:
            return False
        if not data:
            raise OSError(errno.EIO, "the connection was ended" if self.settings.is_tcp else "the device was unplugged")
        self._keep("in", data)
        self._held += data
        return True


def write_all(descriptor: int, data: bytes, timeout_s: float, device: str) -> None:
    """All of ``data`` to a descriptor that does not block, or ``DeviceTimeout``; ``OSError`` without a device."""
    deadline_s = time.monotonic() + timeout_s
    left = memoryview(data)
    while left:
        try:
            written = os.write(descriptor, left)
        except BlockingIOError:
            written = 0
        left = left[written:]
        if left and not select.select([], [descriptor], [], max(0.0, deadline_s - time.monotonic()))[1]:
            raise DeviceTimeout(
                device, f"{len(data)} bytes to be taken within {timeout_s:g} s", f"{len(left)} bytes left",
                "check the cable and that flow control is off",
            )  # fmt: skip


def _open(settings: PortSettings) -> serial.Serial:
    path, device = settings.path, settings.device
    try:
        return serial.Serial(
            path, settings.baud, parity=settings.parity, stopbits=settings.stop_bits, timeout=0, write_timeout=0
        )
    except (OSError, ValueError) as error:
        number = getattr(error, "errno", None)
        if number == errno.EBUSY:
            raise port_lock.busy(device, path) from error
        if number in (errno.EACCES, errno.EPERM):
            raise DeviceMissing(
                device, f"permission to open {path}", "none", "add the user to the group dialout and sign in again"
            ) from error
        found = "nothing there" if number in (errno.ENOENT, None) else str(error.strerror or error)  # type: ignore[union-attr]
        raise DeviceMissing(
            device, f"a serial device at {path}", found, f"check cable and power, or correct its port; {_present()}"
        ) from error


def _connect(settings: PortSettings) -> socket.socket:
    path, device = settings.path, settings.device
    host, _, number = path.partition("://")[2].rpartition(":")
    host = host.strip("[]")
    if not host or not number.isdigit() or int(number) > 0xFFFF:
        raise DeviceMissing(
            device, f"{TCP}host:port or {RTU_TCP}host:port", path, "correct its port in the configuration"
        )
    try:
        connection = socket.create_connection((host, int(number)), CONNECT_TIMEOUT_S)
    except OSError as error:
        raise DeviceMissing(
            device, f"a device that listens at {path}", str(error.strerror or error),
            "check its power and its network, or correct its port",
        ) from error  # fmt: skip
    connection.setblocking(False)
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, UNHEARD_MS)
    return connection


def _present() -> str:
    """What serial devices there are, for the one who has to choose."""
    folder = "/dev/serial/by-id"
    try:
        names = sorted(os.listdir(folder))
    except OSError:
        return f"no serial adapter is plugged in ({folder} is not there)"
    return "there are: " + ", ".join(f"{folder}/{name}" for name in names)

"""A serial wire that ends in a pseudo terminal: bytes take their time at the baud rate, a plug can be pulled.

A pseudo terminal passes bytes at any rate, and some hosts count on that; a ``strict_baud`` wire is like a real one.
"""

from __future__ import annotations

import asyncio
import errno
import fcntl
import os
import sys
import termios
import tty
from collections.abc import Callable
from pathlib import Path

from drivers.emulation.uart import host_baud, misheard, set_host_baud

READ_BYTES = 4096
LOCKS = Path("/proc/locks")


class PtyWire:
    """The device's end of the wire, on the running event loop.

    ``receive`` gets what the host wrote once its last bit has passed the wire; ``send`` gives bytes to the host when
    theirs has. ``link`` is a stable name that is made to point to the terminal while the wire is plugged in.
    Bytes for a host that does not read are lost, as on a real wire. A host that sets no rate has the device's.
    ``strict_baud``: a host at another rate is misheard and mishears.
    """

    def __init__(
        self, baud: int, receive: Callable[[bytes], None], link: Path | None = None, strict_baud: bool = False
    ) -> None:
        self.baud = baud
        self._strict_baud = strict_baud
        self._receive, self._link = receive, link
        self._loop = asyncio.get_running_loop()
        self._master = self._slave = -1
        self._heard_s = self._said_s = 0.0
        self._plugging = 0
        self.path = ""
        self.lost_bytes = 0

    @property
    def byte_s(self) -> float:
        """How long a byte takes (8N1)."""
        return 10.0 / self.baud

    @property
    def host_baud(self) -> int:
        """The rate that the host has set."""
        return (host_baud(self._slave) if self.plugged else 0) or self.baud

    @property
    def plugged(self) -> bool:
        return self._master >= 0

    @property
    def unread(self) -> int:
        """Bytes that have passed the wire and that the host has not read."""
        if not self.plugged:
            return 0
        return int.from_bytes(fcntl.ioctl(self._slave, termios.FIONREAD, b"\0\0\0\0"), sys.byteorder)

    def plug(self) -> None:
        """A terminal appears. Nothing happens when there is one."""
        if self.plugged:
            return
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)
        set_host_baud(self._slave, self.baud)
        os.set_blocking(self._master, False)
        self.path = os.ttyname(self._slave)
        if self._link is not None:
            self._link.parent.mkdir(parents=True, exist_ok=True)
            fresh = self._link.with_name(f".{self._link.name}.new")
            fresh.unlink(missing_ok=True)
            fresh.symlink_to(self.path)
            fresh.replace(self._link)
        self._loop.add_reader(self._master, self._readable)

    def unplug(self) -> None:
        """The terminal vanishes under whoever has it open; what is on the wire is lost."""
        if not self.plugged:
            return
        self._loop.remove_reader(self._master)
        os.close(self._master)
        os.close(self._slave)
        self._master = self._slave = -1
        self._plugging += 1
        if self._link is not None:
            self._link.unlink(missing_ok=True)

    def forget_dead_host(self) -> None:
        """Lift the exclusive use (TIOCEXCL) of a host that is gone, as the last close of a real device does: the end
        that is kept open here would keep it up. A living host is known by its lock.
        """
        if not self.plugged:
            return
        status = os.fstat(self._slave)
        place = f"{os.major(status.st_dev):02x}:{os.minor(status.st_dev):02x}:{status.st_ino}"
        if f" {place} " not in LOCKS.read_text(encoding="ascii"):
            fcntl.ioctl(self._slave, termios.TIOCNXCL)

    def send(self, data: bytes, delay_s: float = 0.0) -> None:
        """Give ``data`` to the host as a whole: it begins ``delay_s`` from now, or after what is under way."""
        self._said_s = max(self._loop.time() + delay_s, self._said_s) + len(data) * self.byte_s
        self._loop.call_at(self._said_s, self._write, data, self._plugging)

    def _readable(self) -> None:
        try:
            data = os.read(self._master, READ_BYTES)
        except BlockingIOError:
            return
        except OSError as error:
            if error.errno == errno.EIO:  # nobody has the other end open; the slave that is kept makes this rare
                return
            raise
        host = self.host_baud if self._strict_baud else self.baud
        self._heard_s = max(self._loop.time(), self._heard_s) + len(data) * 10.0 / host
        heard = misheard(data, host, self.baud)
        self._loop.call_at(self._heard_s, self._arrive, heard, self._plugging)

    def _arrive(self, data: bytes, plugging: int) -> None:
        if data and plugging == self._plugging:
            self._receive(data)

    def _write(self, data: bytes, plugging: int) -> None:
        if plugging != self._plugging or not self.plugged:
            return
        if self._strict_baud:
            data = misheard(data, self.baud, self.host_baud)
        try:
            written = os.write(self._master, data)
        except BlockingIOError:
            written = 0
        self.lost_bytes += len(data) - written

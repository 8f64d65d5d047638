"""Who holds a serial device: an exclusive lock on the device itself, and a lock file that names the holder.

The lock file follows the UUCP convention (``LCK..ttyUSB0``, the process id in ten columns) that pppd and minicom read.
The lock on the device decides; the file only tells the name. The kernel frees the lock when its holder dies.
"""

from __future__ import annotations

import fcntl
import os
import tempfile
import termios
from contextlib import suppress
from pathlib import Path

from drivers.errors import DeviceBusy


def lock_folder() -> Path:
    """Where lock files stand: /run/lock where that can be written, else the folder for temporary files."""
    shared = Path("/run/lock")
    return shared if os.access(shared, os.W_OK) else Path(tempfile.gettempdir())


def lock_file(path: str) -> Path:
    """The lock file of a device; a stable name and the device it points to share one."""
    real = os.path.realpath(path).removeprefix("/dev/").replace("/", "-")
    return lock_folder() / f"LCK..{real}"


def take(descriptor: int, device: str, path: str) -> None:
    """Lock an open device for this process. ``DeviceBusy`` names the process that holds it."""
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        raise busy(device, path) from None
    fcntl.ioctl(descriptor, termios.TIOCEXCL)
    with suppress(OSError):  # the file only names the holder; the lock above stands without it
        file = lock_file(path)
        handle = os.open(file, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_NOFOLLOW | os.O_CLOEXEC, 0o644)
        with os.fdopen(handle, "w") as stream:
            stream.write(f"{os.getpid():10d}\n")


def release(path: str) -> None:
    """Take this process's lock file away; the lock itself goes with the descriptor."""
    if holder(path) == os.getpid():
        with suppress(OSError):
            lock_file(path).unlink()


def holder(path: str) -> int | None:
    """The process that the lock file names, None when there is none or it is dead."""
    try:
        number = int(lock_file(path).read_text(encoding="ascii").split()[0])
    except (OSError, ValueError, IndexError):
        return None
    return number if Path(f"/proc/{number}").exists() else None


def busy(device: str, path: str) -> DeviceBusy:
    """The error for a device that another process holds."""
    number = holder(path)
    who = "another process" if number is None else f"process {number} ({_command(number)})"
    return DeviceBusy(device, f"{path} for this process alone", f"{who} holding it", "stop that process first")


def _command(process: int) -> str:
    try:
        words = Path(f"/proc/{process}/cmdline").read_bytes().split(b"\0")
    except OSError:
        return "its command is not known"
    return b" ".join(words).decode("utf-8", "replace").strip()[:80] or "no command line"

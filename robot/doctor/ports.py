"""A serial port as the operating system shows it: there, ours, quick, and left alone by others."""

from __future__ import annotations

import os
import stat
from collections.abc import Iterator
from pathlib import Path

from drivers import port_lock
from robot.doctor.values import Finding, failure, fine, warning
from robot.errors import BusyError, UnavailableError

LATENCY_MS = 1
INTRUDERS = {"ModemManager": "ID_MM_DEVICE_IGNORE", "brltty": "BRLTTY_BRAILLE_DRIVER"}


def port_findings(device: str, path: str, root: Path = Path("/")) -> Iterator[Finding]:
    """Everything about a port that can be seen without opening it. ``root`` is where /sys, /proc and /run stand."""
    if "://" in path:
        yield fine(device, "port", path)
        return
    real = os.path.realpath(path)
    try:
        mode = os.stat(real)
    except OSError as error:
        yield failure(device, "port", f"{path}: {error.strerror}", "a serial device there",
                      "check cable and power; the names that are there: ls -l /dev/serial/by-id",
                      UnavailableError.exit_code)  # fmt: skip
        return
    if not stat.S_ISCHR(mode.st_mode):
        yield failure(device, "port", f"{path} is not a device", "a serial device",
                      "correct the port in the configuration", UnavailableError.exit_code)  # fmt: skip
        return
    yield _name(device, path, real)
    if not os.access(real, os.R_OK | os.W_OK):
        yield failure(device, "permission", "none", f"reading and writing {real}",
                      "add the user to the group dialout and sign in again", UnavailableError.exit_code)  # fmt: skip
    yield _holder(device, path)
    if not real.startswith("/dev/pts/"):
        yield from adapter_findings(device, os.path.basename(real), mode.st_rdev, root)


def _name(device: str, path: str, real: str) -> Finding:
    shown = path if path == real else f"{path} -> {real}"
    if os.path.basename(real).startswith(("ttyUSB", "ttyACM")) and path == real:
        return warning(device, "port", path, "a stable name", "use its name in /dev/serial/by-id: numbers change")
    return fine(device, "port", shown)


def _holder(device: str, path: str) -> Finding:
    number = port_lock.holder(path)
    if number is None or number == os.getpid():
        return fine(device, "held by", "nobody")
    return failure(device, "held by", f"process {number}", "nobody", "stop that process (is the service running?)",
                   BusyError.exit_code)  # fmt: skip


def adapter_findings(device: str, name: str, rdev: int, root: Path) -> Iterator[Finding]:
    """What sysfs, udev and the running processes say of a serial adapter."""
    for process in _users(f"/dev/{name}", root):
        yield warning(device, "open in", process, "this program alone", "stop it: two readers share what comes in")
    timer = root / "sys/bus/usb-serial/devices" / name / "latency_timer"
    if timer.exists():
        latency_ms = int(timer.read_text(encoding="ascii").strip())
        if latency_ms > LATENCY_MS:
            yield warning(device, "latency timer", f"{latency_ms} ms", f"{LATENCY_MS} ms",
                          "install the udev rules (systemd/60-sprayer-ports.rules)")  # fmt: skip
        else:
            yield fine(device, "latency timer", f"{latency_ms} ms")
    properties = root / f"run/udev/data/c{os.major(rdev)}:{os.minor(rdev)}"
    marks = properties.read_text(encoding="utf-8", errors="replace") if properties.exists() else ""
    running = set(_commands(root)) & set(INTRUDERS)
    if "ModemManager" in running and not ("ID_MM_DEVICE_IGNORE=1" in marks or "ID_MM_PORT_IGNORE=1" in marks):
        yield warning(device, "left alone", "ModemManager runs and may probe this port", "it told to keep off",
                      "install the udev rules (systemd/60-sprayer-ports.rules)")  # fmt: skip
    elif "brltty" in running:
        yield warning(device, "left alone", "brltty runs and takes serial adapters", "it gone",
                      "apt remove brltty")  # fmt: skip
    else:
        yield fine(device, "left alone", "nobody probes it")


def _users(path: str, root: Path) -> Iterator[str]:
    """Other processes that have the port open, whether they lock it or not; without root one sees one's own only."""
    for folder in (root / "proc").glob("[0-9]*"):
        if folder.name == str(os.getpid()):
            continue
        try:
            if any(os.readlink(link) == path for link in (folder / "fd").iterdir()):
                yield f"process {folder.name} ({(folder / 'comm').read_text(errors='replace').strip()})"
        except OSError:
            continue  # it has ended meanwhile, or is another user's


def _commands(root: Path) -> Iterator[str]:
    for process in (root / "proc").glob("[0-9]*/comm"):
        try:
            yield process.read_text(encoding="utf-8", errors="replace").strip()
        except OSError:
            continue  # it has ended meanwhile

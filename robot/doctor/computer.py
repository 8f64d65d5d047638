"""The computer: its clock, its disk, and the files that a run needs."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from pathlib import Path

from robot.doctor.values import Finding, failure, fine, warning
from robot.errors import FileError

LEAST_FREE_SHARE = 0.07  # below this the disk counts as full
LEAST_FREE_BYTES = 64 * 1024 * 1024
EARLIEST = datetime(2026, 1, 1, tzinfo=UTC)  # before this program was written no clock is right
CALIBRATION_AGE = timedelta(days=180)


def clock_finding(now: datetime, synchronised: bool | None) -> Finding:
    """``synchronised`` as the operating system says, None when it does not."""
    shown = now.strftime("%Y-%m-%d %H:%M:%S UTC")
    remedy = "set up a time source (systemd-timesyncd, chrony or the GPS receiver)"
    if now < EARLIEST:
        return warning("clock", "time", shown, "the time of today", remedy)
    if synchronised is False:
        return warning("clock", "time", f"{shown}, not synchronised", "a synchronised clock", remedy)
    return fine("clock", "time", shown if synchronised is None else f"{shown}, synchronised")


def clock_synchronised() -> bool | None:
    """What systemd says of the clock; None where it cannot be asked."""
    program = shutil.which("timedatectl")
    if program is None:
        return None
    command = [program, "show", "--property=NTPSynchronized", "--value"]
    answer = subprocess.run(command, capture_output=True, text=True, timeout=5.0, check=False)
    return {"yes": True, "no": False}.get(answer.stdout.strip())


def disk_finding(folder: Path) -> Finding:
    """Whether the run directory can hold a ledger."""
    existing = next(path for path in (folder.absolute(), *folder.absolute().parents) if path.exists())
    usage = shutil.disk_usage(existing)
    shown = f"{usage.free / 2**30:.1f} GiB free at {existing}"
    if usage.free < LEAST_FREE_BYTES:
        return failure("disk", "space", shown, f"{LEAST_FREE_BYTES // 2**20} MiB", "delete old frames",
                       FileError.exit_code)  # fmt: skip
    if usage.free < LEAST_FREE_SHARE * usage.total:
        return warning("disk", "space", shown, f"{LEAST_FREE_SHARE:.0%} of the disk", "delete old frames")
    return fine("disk", "space", shown)


def calibration_findings(path: Path, now: datetime) -> Iterator[Finding]:
    """How old the camera's calibration is, by its file."""
    written = datetime.fromtimestamp(path.stat().st_mtime, UTC)
    age = now - written
    shown = f"{path.name}, {max(0, age.days)} days old"
    if age > CALIBRATION_AGE:
        yield warning("camera", "calibration", shown, f"at most {CALIBRATION_AGE.days} days",
                      "calibrate again: sprayer calibrate camera")  # fmt: skip
    else:
        yield fine("camera", "calibration", shown)

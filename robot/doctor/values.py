"""One line of the doctor's table, and what all of them make of the exit code."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from enum import StrEnum

from drivers.errors import DeviceBusy, DeviceError
from robot.errors import BusyError, ConfigError, SprayerError, UnavailableError

_WORST_FIRST = (ConfigError.exit_code, UnavailableError.exit_code, BusyError.exit_code, SprayerError.exit_code)


class Level(StrEnum):
    """``WARN`` lets the robot work, ``FAIL`` does not."""

    OK = "ok"
    WARN = "warn"
    FAIL = "fail"


@dataclass(frozen=True, slots=True)
class Finding:
    """``device`` and ``what`` was looked at, what was ``expected`` and ``found``; ``remedy`` is "" when all is well.

    ``code`` is the exit code that this line asks for.
    """

    device: str
    what: str
    level: Level
    found: str
    expected: str = ""
    remedy: str = ""
    code: int = 0


def fine(device: str, what: str, found: str) -> Finding:
    return Finding(device, what, Level.OK, found)


def warning(device: str, what: str, found: str, expected: str, remedy: str) -> Finding:
    return Finding(device, what, Level.WARN, found, expected, remedy, SprayerError.exit_code)


def failure(device: str, what: str, found: str, expected: str, remedy: str, code: int) -> Finding:
    return Finding(device, what, Level.FAIL, found, expected, remedy, code)


def of_device_error(device: str, what: str, error: DeviceError) -> Finding:
    """What a driver says when it cannot: its own words in the table's columns."""
    code = BusyError.exit_code if isinstance(error, DeviceBusy) else UnavailableError.exit_code
    return failure(device, what, error.found, error.expected, error.remedy, code)


def exit_code(findings: Iterable[Finding]) -> int:
    """0 when nothing is wrong, else the code of the worst: configuration, missing device, busy port, warning."""
    codes = {finding.code for finding in findings}
    return next((code for code in _WORST_FIRST if code in codes), 0)

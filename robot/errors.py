"""Errors for the person at the terminal, each with the exit code of its kind (BSD sysexits)."""

from __future__ import annotations


class SprayerError(Exception):
    """A one-line message that names the thing and the remedy. Exit code 1: finished with failures."""

    exit_code = 1


class UsageError(SprayerError):
    """The command was called wrongly."""

    exit_code = 64


class UnavailableError(SprayerError):
    """A device is not there or does not do its part."""

    exit_code = 69


class FileError(SprayerError):
    """A file cannot be read or written, or does not hold what it should."""

    exit_code = 74


class BusyError(SprayerError):
    """Another process holds the thing."""

    exit_code = 75


class ConfigError(SprayerError):
    """The configuration (or a calibration, route or arm description that it names) is wrong."""

    exit_code = 78

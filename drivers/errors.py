"""What can go wrong with a device, told to the person who has to mend it."""

from __future__ import annotations


class DeviceError(Exception):
    """A device did not do what was asked of it.

    ``expected`` is what should have been, ``found`` what was, ``remedy`` what a person can do about it.
    """

    def __init__(self, device: str, expected: str, found: str, remedy: str) -> None:
        super().__init__(f"{device}: expected {expected}, found {found}; {remedy}")
        self.device = device
        self.expected = expected
        self.found = found
        self.remedy = remedy


class DeviceMissing(DeviceError):
    """There is nothing at the place where the configuration says the device is."""


class DeviceTimeout(DeviceError):
    """The device is there and did not answer in time."""


class DeviceLost(DeviceError):
    """The device was there and is gone (unplugged, closed, powered off)."""


class DeviceFault(DeviceError):
    """The device answered that it cannot (hardware error, exception reply, limit)."""


class DeviceRefused(DeviceError):
    """The driver itself refuses the command: it would break the contract of the device."""


class DeviceBusy(DeviceError):
    """Another process holds the device's port."""


class WrongDevice(DeviceError):
    """Something answers at this place, and it is not the device that the configuration names."""

"""A relay board by its profile, spoken to in the owner thread of its bus."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeVar

from drivers import modbus_pdu as pdu
from drivers.errors import DeviceError, DeviceFault, DeviceTimeout
from drivers.modbus_master import ModbusUnit
from drivers.modbus_probe import TRIES
from drivers.relay.board_profile import BoardProfile, PowerOn, Watchdog, Write

T = TypeVar("T")


class Board:
    """Closing is tried up to ``TRIES`` times, opening once. Channels are numbered from 1, as on the board."""

    def __init__(self, unit: ModbusUnit, profile: BoardProfile) -> None:
        self._unit, self._profile = unit, profile

    def on(self, number: int) -> None:
        """A coil on until further notice."""
        if self._profile.off_first:
            self.cancel(number)
        self._send(self._profile.on.of(number))

    def pulse(self, number: int, quanta: int) -> None:
        """A coil on for so many quanta of the board's timer."""
        assert self._profile.pulse is not None
        self._send(self._profile.pulse.write.of(number, quanta))

    def cancel(self, number: int) -> None:
        """A coil off and its timer stopped."""
        write = self._profile.cancel.of(number)
        _again_and_again(lambda: self._send(write), TRIES)

    def all_off(self, numbers: Sequence[int]) -> None:
        """Every coil off, the timers of ``numbers`` stopped, the first named first. Goes on past errors, raises one."""
        first: DeviceError | None = None
        tries = TRIES
        for write in self._profile.all_off(numbers):
            try:
                _again_and_again(lambda write=write: self._send(write), tries)  # type: ignore[misc]
            except DeviceError as error:
                first, tries = first or error, 1
        if first is not None:
            raise first

    def read(self) -> list[bool]:
        """The contacts, channel 1 first."""
        place = self._profile.read
        if place.function == pdu.READ_COILS:
            return self._unit.read_coils(place.first, self._profile.channels)
        return [bool(word) for word in self._unit.read_holding(place.first, self._profile.channels)]

    def stay_off_at_power_on(self, register: PowerOn) -> None:
        self._settle(register.address, register.off, "coils to stay off when power returns")

    def arm(self, watchdog: Watchdog, after_s: float) -> None:
        units = round(after_s / watchdog.unit_s)
        self._settle(watchdog.address, units, f"the watchdog to be armed with {after_s:g} s")

    def _settle(self, address: int, value: int, what: str) -> None:
        """A holding register holds ``value``, verified; it is written only when it must be."""
        if _again_and_again(lambda: self._unit.read_holding(address, 1), TRIES) == [value]:
            return
        _again_and_again(lambda: self._unit.write_register(address, value), TRIES)
        found = _again_and_again(lambda: self._unit.read_holding(address, 1), TRIES)
        if found != [value]:
            raise DeviceFault(
                "relay", f"{what} (register {address} to hold {value})", str(found[0]),
                "replace the board: it does not keep its settings",
            )  # fmt: skip

    def _send(self, write: Write) -> None:
        self._unit.send(write.request())


def _again_and_again(action: Callable[[], T], tries: int) -> T:
    for _ in range(tries - 1):
        try:
            return action()
        except (DeviceTimeout, DeviceFault):
            continue
    return action()

"""What must be known of a relay board to drive it, as data."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from drivers import modbus_pdu as pdu
from drivers.modbus_probe import Probe


@dataclass(frozen=True, slots=True)
class Write:
    """Function 05 and 06 take one value, 15 (coils, 0 or 1) and 16 (words) several from ``address`` on."""

    function: int
    address: int
    values: tuple[int, ...]

    def request(self) -> pdu.Request:
        if self.function == pdu.WRITE_COIL:
            return pdu.write_coil(self.address, self.values[0])
        if self.function == pdu.WRITE_REGISTER:
            return pdu.write_register(self.address, self.values[0])
        if self.function == pdu.WRITE_COILS:
            return pdu.write_coils(self.address, [bool(value) for value in self.values])
        return pdu.write_registers(self.address, self.values)


@dataclass(frozen=True, slots=True)
class ChannelWrite:
    """A write for one channel: ``first`` is the address of channel 1, the next channel's is ``stride`` further.

    The number of quanta of a pulse is added to ``values[timed]``.
    """

    function: int
    first: int
    values: tuple[int, ...]
    stride: int = 1
    timed: int = 0

    def of(self, number: int, quanta: int = 0) -> Write:
        values = list(self.values)
        values[self.timed] += quanta
        return Write(self.function, self.first + (number - 1) * self.stride, tuple(values))


@dataclass(frozen=True, slots=True)
class PulseTimer:
    """The board's own timer: a pulse is 1 to ``most`` quanta long, and restarts when it is written again."""

    write: ChannelWrite
    quantum_s: float
    most: int


@dataclass(frozen=True, slots=True)
class ReadBack:
    """Where the contacts are read: coils (01) or one word a channel (03), from ``first`` on."""

    function: int
    first: int


@dataclass(frozen=True, slots=True)
class PowerOn:
    """The holding register that says what the coils do when power returns; ``off`` keeps them off."""

    address: int
    off: int


@dataclass(frozen=True, slots=True)
class Watchdog:
    """The holding register that holds after how many ``unit_s`` of silence everything goes off; 0 is never."""

    address: int
    unit_s: float
    most: int


@dataclass(frozen=True, slots=True)
class BoardProfile:
    """One kind of board.

    ``cancel`` opens the coil and stops a running timer for certain; ``clear`` opens the coils of the whole board, and
    with ``clear_stops_timers`` stops their timers too. ``off_first``: switching on needs a stopped timer. Coils of a
    board without ``power_on`` are off when power returns.
    """

    name: str
    title: str
    channels: int
    probes: tuple[Probe, ...]
    on: ChannelWrite
    cancel: ChannelWrite
    clear: Write
    read: ReadBack
    pulse: PulseTimer | None = None
    watchdog: Watchdog | None = None
    power_on: PowerOn | None = None
    clear_stops_timers: bool = True
    off_first: bool = False

    def all_off(self, numbers: Sequence[int]) -> tuple[Write, ...]:
        """Everything off; what ``clear`` does not stop is cancelled first, in the order of ``numbers``."""
        each = () if self.clear_stops_timers else tuple(self.cancel.of(number) for number in numbers)
        return (*each, self.clear)

"""The contract of a relay board."""

from __future__ import annotations

from typing import Protocol

from drivers.relay.values import BoardCapability, Channel, PulseReceipt, RelayState
from drivers.stop_lane import StopLane


class RelayBoard(Protocol):
    """A relay board whose pulses are timed on the board.

    Every method raises a ``DeviceError``; every wait ends in ``DeviceTimeout``. After a time-out the state of the
    coil is unknown: the caller must assume the worse.
    """

    @property
    def stop_lane(self) -> StopLane | None:
        """The stop from any thread; None for a simulated device, which belongs to the event loop with its machine."""
        ...

    @property
    def capability(self) -> BoardCapability: ...

    @property
    def channels(self) -> frozenset[Channel]:
        """The channels that the configuration wires."""
        ...

    async def open(self) -> None:
        """Connect, switch everything off, verify by read-back."""
        ...

    async def close(self) -> None:
        """Everything off, then disconnect."""
        ...

    async def switch(self, channel: Channel, on: bool) -> None:
        """Switch a coil until further notice. Valve and pump are only ever pulsed: ``DeviceRefused`` for on."""
        ...

    async def pulse(self, channel: Channel, duration_s: float) -> PulseReceipt:
        """Close the coil now; the board opens it again by itself.

        ``duration_s`` is rounded up to the board's quantum; ``DeviceRefused`` outside (0, pulse_max_s]. A pulse on a
        running pulse restarts its timer. The host may end it sooner with ``cancel``.
        """
        ...

    async def cancel(self, channel: Channel) -> None:
        """Open the coil now and stop its timer; verified by the board's answer."""
        ...

    async def all_off(self) -> None: ...

    async def read(self) -> RelayState: ...

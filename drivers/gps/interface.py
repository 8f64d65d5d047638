"""The contract of a GPS receiver."""

from __future__ import annotations

from typing import Protocol

from drivers.gps.values import Fix


class Gps(Protocol):
    """A receiver that reports at its own rate. Every method raises a ``DeviceError``."""

    async def open(self) -> None: ...

    async def close(self) -> None: ...

    async def next_fix(self) -> Fix:
        """The next epoch that completes after this call; ``DeviceTimeout`` when the receiver stays silent.

        A receiver that speaks and has no position gives a ``Fix`` of quality NONE.
        """
        ...

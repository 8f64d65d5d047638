"""A production driver and the emulated device behind it, as a contract test needs them."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Sequence
from dataclasses import dataclass, field
from typing import Generic, TypeVar

from drivers.emulation.wire import PtyWire
from drivers.serial_port import SerialPort

D = TypeVar("D")


async def _nothing() -> None:
    """There is nothing else to take down."""


@dataclass(frozen=True)
class Rigged(Generic[D]):
    """``device`` speaks over ``ports``, whose other ends are ``wires``; ``more_busy`` tells of other work under way."""

    device: D
    ports: Sequence[SerialPort] = ()
    wires: Sequence[PtyWire] = ()
    more_busy: Callable[[], bool] = lambda: False
    before_unplugging: Callable[[], Awaitable[None]] = field(default=_nothing)

    def busy(self) -> bool:
        return any(port.busy for port in self.ports) or any(wire.unread for wire in self.wires) or self.more_busy()

    async def take_down(self) -> None:
        await self.before_unplugging()
        for wire in self.wires:
            wire.unplug()

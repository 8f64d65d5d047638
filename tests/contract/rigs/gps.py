"""The production receiver on an emulated one."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from contextlib import suppress

from drivers.emulation.bad_line import BadLine
from drivers.emulation.wire import PtyWire
from drivers.gps.emulator import EmulatedReceiver, GpsEmulator
from drivers.gps.nmea import NmeaGps, NmeaSettings
from drivers.line import PortSettings
from drivers.twin import Twin
from tests.contract.rigged import Rigged

SENDS = EmulatedReceiver(kinds=("RMC", "GGA", "VTG", "GSA", "GST", "HDT"))


class CountingWire(PtyWire):
    """Knows how many bytes it has given to the host."""

    given_bytes = 0

    def _write(self, data: bytes, plugging: int) -> None:
        if self.plugged:
            self.given_bytes += len(data)
        super()._write(data, plugging)


def emulated_gps(twin: Twin, clock: Callable[[], float], receiver: EmulatedReceiver = SENDS) -> Rigged[NmeaGps]:
    emulator = GpsEmulator(twin, clock, receiver)
    wire = CountingWire(receiver.baud, emulator.receive)
    emulator.connect(BadLine("gps", twin, clock, wire.send, wire.byte_s))
    wire.plug()
    life = asyncio.get_running_loop().create_task(emulator.serve())
    device = NmeaGps(NmeaSettings(), PortSettings(wire.path, "gps", receiver.baud, "nmea"), clock)

    def reading() -> bool:
        """Bytes that have left the terminal may not have reached the event loop."""
        return device.heard_bytes != wire.given_bytes - wire.lost_bytes

    async def end() -> None:
        life.cancel()
        with suppress(asyncio.CancelledError):
            await life

    return Rigged(device, [device.port], [wire], reading, end)

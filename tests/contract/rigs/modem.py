"""The GSM driver with the emulated modem behind its AT port."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from contextlib import suppress

from drivers.emulation.bad_line import BadLine
from drivers.emulation.wire import PtyWire
from drivers.line import PortSettings
from drivers.modem.emulator import ModemEmulator
from drivers.modem.gsm import GsmModem
from drivers.modem.gsm_settings import GsmSettings
from drivers.twin import Twin
from tests.contract.rigged import Rigged

BAUD = 115_200
SENDING_S = 0.5  # of real time, in which nothing leaps
SETTINGS = GsmSettings(answer_timeout_s=2.0, delivery_reports=True)


def emulated_modem(twin: Twin, clock: Callable[[], float]) -> Rigged[GsmModem]:
    emulator = ModemEmulator(twin, clock, sending_s=SENDING_S)
    wire = PtyWire(BAUD, emulator.receive)
    emulator.connect(BadLine("modem", twin, clock, wire.send, wire.byte_s))
    wire.plug()
    serving = asyncio.get_running_loop().create_task(emulator.serve())

    async def stop() -> None:
        serving.cancel()
        with suppress(asyncio.CancelledError):
            await serving

    device = GsmModem.on_port(SETTINGS, PortSettings(wire.path, "modem", BAUD, "at"), clock)
    return Rigged(device, [device.port], [wire], before_unplugging=stop)

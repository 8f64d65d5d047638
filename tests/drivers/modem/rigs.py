"""The GSM driver and an emulated modem that a test may touch, in real time that leaps over silence."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from drivers.emulation.bad_line import BadLine
from drivers.emulation.wire import PtyWire
from drivers.errors import DeviceError
from drivers.line import PortSettings
from drivers.modem.emulated_sim import EmulatedSim
from drivers.modem.emulator import ModemEmulator
from drivers.modem.gsm import GsmModem
from drivers.modem.gsm_settings import GsmSettings
from drivers.twin import Twin
from drivers.twin import commands as c
from tests.contract.leaping import LeapingLoop
from tests.drivers.twin import rig

BAUD = 115_200
WORKER = "+4915112345678"
QUICK = GsmSettings(answer_timeout_s=2.0)


@dataclass
class Rig:
    device: GsmModem
    emulator: ModemEmulator
    twin: Twin
    wire: PtyWire
    clock: Callable[[], float]
    heard: bytearray
    power_cycles: list[float] = field(default_factory=list)

    def text(self, text: str, sender: str = WORKER) -> None:
        self.twin.apply(self.clock(), c.WorldText(sender, text))

    def network(self, registered: bool) -> None:
        self.twin.apply(self.clock(), c.WorldNetwork(registered))

    async def received(self, count: int, longest_s: float = 300.0) -> list[str]:
        """What comes in until there are ``count`` texts."""
        texts: list[str] = []
        async with asyncio.timeout(longest_s):
            while len(texts) < count:
                texts += [sms.text for sms in await self.device.receive()]
                await asyncio.sleep(0.5)
        return texts

    async def until(self, condition: Callable[[], bool], longest_s: float = 300.0, step_s: float = 0.1) -> None:
        async with asyncio.timeout(longest_s):
            while not condition():  # noqa: ASYNC110 - the emulated world gives no signal
                await asyncio.sleep(step_s)


def run(
    test: Callable[[Rig], Awaitable[None]],
    *faults: str,
    settings: GsmSettings = QUICK,
    sim: EmulatedSim | None = None,
    opened: bool = True,
    prepare: Callable[[ModemEmulator], None] = lambda emulator: None,
    link: Path | None = None,
    sending_s: float = 0.3,
    **options: Any,
) -> Twin:
    twin = rig.twin(*faults)

    async def main() -> None:
        loop = asyncio.get_running_loop()
        assert isinstance(loop, LeapingLoop)
        emulator = ModemEmulator(twin, loop.time, sim, sending_s=sending_s, **options)
        heard = bytearray()

        def receive(data: bytes) -> None:
            heard.extend(data)
            emulator.receive(data)

        wire = PtyWire(BAUD, receive, link)
        emulator.connect(BadLine("modem", twin, loop.time, wire.send, wire.byte_s))
        wire.plug()
        prepare(emulator)
        serving = loop.create_task(emulator.serve())

        async def power_cycle() -> None:
            bench.power_cycles.append(loop.time())
            emulator.restart()

        place = PortSettings(str(link or wire.path), "modem", BAUD, "at")
        device = GsmModem.on_port(settings, place, loop.time, power_cycle)
        bench = Rig(device, emulator, twin, wire, loop.time, heard)
        loop.busy = lambda: device.port.busy or bool(wire.unread)
        try:
            if opened:
                await device.open()
            await test(bench)
            twin.advance(loop.time())
        finally:
            with suppress(DeviceError):
                await device.close()
            serving.cancel()
            with suppress(asyncio.CancelledError):
                await serving
            wire.unplug()

    with asyncio.Runner(loop_factory=LeapingLoop) as runner:
        runner.run(main())
    return twin

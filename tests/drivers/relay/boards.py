"""A driver and an emulated board of any profile, in real time that leaps over silence; every byte is kept."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

from drivers.emulation.reference_bus import ReferenceBus
from drivers.errors import DeviceError
from drivers.line import PortSettings
from drivers.modbus_frames import FrameFinder, answer_size, request_size
from drivers.modbus_master import ModbusMaster
from drivers.relay.modbus import ModbusRelay, RelaySettings
from drivers.relay.profiles import PROFILES
from drivers.relay.values import Channel
from drivers.serial_port import SerialPort
from tests.contract.leaping import LeapingLoop
from tests.drivers.twin import rig

BAUD = 115200
WIRED = {Channel.VALVE: 1, Channel.PUMP: 2, Channel.LAMP: 3, Channel.BEACON: 5}
TIMED = [name for name, profile in PROFILES.items() if profile.pulse is not None]
WATCHED = [name for name, profile in PROFILES.items() if profile.watchdog is not None]
WRITES = (5, 6, 15, 16)


class Recorder:
    """Stands where a byte trace does."""

    def __init__(self) -> None:
        self.sent = b""
        self.heard = b""

    def keep(self, stamp_s: float, direction: str, data: bytes) -> None:
        if direction == "out":
            self.sent += data
        else:
            self.heard += data

    def requests(self) -> list[bytes]:
        return [found.data for found in FrameFinder(request_size).feed(self.sent) if found.is_frame]

    def answers(self) -> list[bytes]:
        return [found.data for found in FrameFinder(answer_size).feed(self.heard) if found.is_frame]

    def writes(self) -> list[bytes]:
        return [frame for frame in self.requests() if frame[1] in WRITES]


class Bench:
    """``board`` and ``bus`` are the emulated ones, ``relay`` is the driver."""

    def __init__(
        self, profile: str, faults: tuple[str, ...], actual: str, unit_id: int, link: Path | None, **settings: Any
    ) -> None:
        self.clock = asyncio.get_running_loop().time
        self.twin = rig.twin(*faults)
        self.bus = ReferenceBus(self.twin, self.clock, profile=actual, relay_unit=unit_id, wired=WIRED, link=link)
        self.bus.wire.plug()
        self.trace = Recorder()
        path = str(link or self.bus.wire.path)
        self.port = SerialPort(PortSettings(path, "relay", BAUD, "modbus"), self.clock, trace=self.trace)  # type: ignore[arg-type]
        self.master = ModbusMaster(self.port)
        timer = PROFILES[profile].pulse
        told: dict[str, Any] = {"lease_s": 2.0 * timer.quantum_s if timer is not None else 1.0}
        self.settings = RelaySettings(profile, unit_id, WIRED, **told | settings)
        self.relay = ModbusRelay(self.settings, self.master, self.clock)
        loop = asyncio.get_running_loop()
        assert isinstance(loop, LeapingLoop)
        loop.busy = lambda: self.port.busy or bool(self.bus.wire.unread)

    def on(self, channel: Channel = Channel.VALVE) -> bool:
        return self.twin.coils(self.clock())[channel]


Test = Callable[[Bench], Awaitable[None]]


def on_board(
    profile: str,
    test: Test,
    *faults: str,
    actual: str | None = None,
    opened: bool = True,
    unit_id: int = 1,
    link: Path | None = None,
    **settings: Any,
) -> None:
    async def main() -> None:
        bench = Bench(profile, faults, actual or profile, unit_id, link, **settings)
        try:
            if opened:
                await bench.relay.open()
            await test(bench)
        finally:
            with suppress(DeviceError):
                await bench.relay.close()
            bench.bus.wire.unplug()

    with asyncio.Runner(loop_factory=LeapingLoop) as runner:
        runner.run(main())


async def until(condition: Callable[[], bool], longest_s: float = 10.0) -> None:
    loop = asyncio.get_running_loop()
    end_s = loop.time() + longest_s
    while not condition():
        assert loop.time() < end_s, "waited in vain"
        await asyncio.sleep(0.005)

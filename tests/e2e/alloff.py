"""The all-off script as systemd and people call it, and what it meets: boards with coils on, and a living service."""

from __future__ import annotations

import asyncio
import json
import os
import struct
from collections.abc import AsyncIterator, Callable, Mapping
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from drivers.emulation.bad_line import BadLine
from drivers.emulation.modbus_slave import ModbusSlaves, TcpSlaves
from drivers.emulation.tcp_wire import TcpWire
from drivers.emulation.wire import PtyWire
from drivers.relay.emulator import EmulatedBoard, emulated_board
from drivers.relay.profiles import PROFILES
from drivers.relay.values import Channel
from drivers.twin import Twin
from drivers.wheels import zlac_registers as zlac
from drivers.wheels.emulator import Zlac8015dEmulator
from robot.config import Config, load_config
from robot.package_files import packaged
from robot.runtime.alloff_file import write_alloff_file
from tests.drivers.twin import rig

SCRIPT = packaged("systemd") / "sprayer-alloff"
EMULATED = packaged("configs") / "emulated.toml"
WIRED = {Channel.VALVE: 1, Channel.PUMP: 2, Channel.LAMP: 3, Channel.CONTACTOR: 4, Channel.BEACON: 5}
UNIT = 7
LONG_S = 20.0


@dataclass(frozen=True)
class Called:
    """How the script ended and what it said."""

    code: int
    said: str


async def call(*arguments: str, env: Mapping[str, str] | None = None) -> Called:
    """Run the script as it is installed, without the project's packages in reach."""
    environment = {"PATH": os.environ["PATH"]} | dict(env or {})
    process = await asyncio.create_subprocess_exec(
        str(SCRIPT), *arguments, stdin=asyncio.subprocess.DEVNULL, stderr=asyncio.subprocess.PIPE, cwd="/",
        env=environment,
    )  # fmt: skip
    _, errors = await asyncio.wait_for(process.communicate(), 30.0)
    assert process.returncode is not None
    return Called(process.returncode, errors.decode())


async def until(condition: Callable[[], bool], longest_s: float = 5.0) -> None:
    """Wait for the emulated machine."""
    async with asyncio.timeout(longest_s):
        while True:
            if condition():
                return
            await asyncio.sleep(0.01)


@dataclass
class Machine:
    """An emulated relay board, and wheels when asked for, with everything on that can be on."""

    twin: Twin
    board: EmulatedBoard
    clock: Callable[[], float]
    config: Config
    wire: PtyWire | TcpWire
    controller: Zlac8015dEmulator

    def roll(self) -> None:
        """The base on its way, as a host left it that set no time-out."""
        for register, value in ((zlac.MODE, zlac.VELOCITY_MODE), (zlac.CONTROL, zlac.Control.ENABLE)):
            self.controller.answer(6, register.address.to_bytes(2, "big") + value.to_bytes(2, "big"))
        head = struct.pack(">HHB", zlac.LEFT_TARGET.address, 2, 4)
        self.controller.answer(16, head + struct.pack(">hh", 20, -20))  # the right wheel is mounted mirrored

    @property
    def valve_open(self) -> bool:
        self.twin.advance(self.clock())
        return self.twin.valve_open

    @property
    def speed_m_s(self) -> float:
        self.twin.advance(self.clock())
        return self.twin.physics.drive.speeds_m_s[0]

    def switch_all_on(self) -> None:
        """Valve and pump on a running pulse, as does every second relay with nothing on it; the others until further
        notice.
        """
        for number in range(1, self.board.outputs.count + 1):
            if number in (WIRED[Channel.VALVE], WIRED[Channel.PUMP]) or number % 2 == 0:
                self.board.outputs.pulse(number, LONG_S)
            else:
                self.board.outputs.switch(number, True)
        assert all(self.board.outputs.contacts())
        assert all(self.twin.coils(self.clock()).values())

    @property
    def on(self) -> list[int]:
        """Relays that are on, in truth; the twin's channels among them."""
        now_s = self.clock()
        coils = self.twin.coils(now_s)
        contacts = self.board.outputs.contacts()
        return [
            number
            for number, contact in enumerate(contacts, start=1)
            if contact or any(coils[channel] for channel, wired in WIRED.items() if wired == number)
        ]

    def write_file(self, path: Path, socket: Path = Path("/nonexistent/control.sock")) -> Path:
        write_alloff_file(self.config, path, socket)
        return path


@asynccontextmanager
async def machine(
    profile: str = "waveshare-8", *faults: str, baud: int = 115200, scheme: str = "", wheels: bool = False
) -> AsyncIterator[Machine]:
    """A board of the profile on a pty, or behind TCP with ``scheme``; ``wheels`` puts a ZLAC8015D on the same bus."""
    loop = asyncio.get_running_loop()
    zero_s = loop.time()

    def clock() -> float:
        return loop.time() - zero_s

    twin = rig.twin(*faults, channels=frozenset(WIRED))
    wired = {channel: number for channel, number in WIRED.items() if number <= PROFILES[profile].channels}
    board = emulated_board(profile, UNIT, twin, clock, wired)
    slaves = TcpSlaves() if scheme == "tcp" else ModbusSlaves(clock, 10.0 / baud)
    wire = TcpWire(slaves.receive, scheme, 0.0 if scheme == "tcp" else 10.0 / baud) if scheme else PtyWire(
        baud, slaves.receive
    )  # fmt: skip
    slaves.add(UNIT, board, BadLine("relay", twin, clock, wire.send, wire.byte_s))
    controller = Zlac8015dEmulator(twin, clock)
    if wheels:
        slaves.add(UNIT + 1, controller, BadLine("wheels", twin, clock, wire.send, wire.byte_s))
    if isinstance(wire, TcpWire):
        await wire.plug()
    else:
        wire.plug()
    try:
        yield Machine(twin, board, clock, _config(profile, wire.path, baud, wheels), wire, controller)
    finally:
        if isinstance(wire, TcpWire):
            await wire.unplug()
        else:
            wire.unplug()


def _config(profile: str, port: str, baud: int, wheels: bool) -> Config:
    config = load_config(EMULATED)
    told: dict[str, Any] = {"port": port, "baud": baud, "unit": UNIT, "profile": profile}
    told["channels"] = config.relay.channels.model_copy(update={channel.value: n for channel, n in WIRED.items()})
    base = load_config(packaged("configs") / "demo.toml").wheels  # a mock: nothing to speak with
    if wheels:
        base = config.wheels.model_copy(update={"port": port, "baud": baud, "unit": UNIT + 1})
    return config.model_copy(update={"relay": config.relay.model_copy(update=told), "wheels": base})


@dataclass
class Service:
    """A control socket that answers ``POST /v1/stop`` with ``status`` and ``body``, and keeps what it was told."""

    path: Path
    status: int = 200
    body: object = None
    silent: bool = False
    heard: list[tuple[str, object]] = field(default_factory=list)

    @asynccontextmanager
    async def serving(self) -> AsyncIterator[Service]:
        server = await asyncio.start_unix_server(self._serve, self.path)
        try:
            yield self
        finally:
            server.close()

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        head = (await reader.readuntil(b"\r\n\r\n")).decode()
        length = next(int(line.split(":")[1]) for line in head.lower().splitlines() if "content-length" in line)
        self.heard.append((head.splitlines()[0], json.loads(await reader.readexactly(length))))
        if self.silent:
            await reader.read()
        else:
            body = json.dumps(self.body).encode()
            writer.write(b"HTTP/1.1 %d X\r\nContent-Length: %d\r\n\r\n" % (self.status, len(body)) + body)
        writer.close()

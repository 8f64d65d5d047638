"""An arm of emulated servos with both its ends at hand, in real time that leaps over silence."""

from __future__ import annotations

import asyncio
import math
import os
import tempfile
import termios
from collections.abc import Awaitable, Callable
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from drivers.arm.dynamixel import DynamixelArm
from drivers.arm.emulator import DynamixelEmulator
from drivers.arm.protocol2 import Packet, PacketReader
from drivers.arm.values import JointTrajectory
from drivers.emulation.bad_line import BadLine
from drivers.emulation.wire import PtyWire
from drivers.errors import DeviceError
from drivers.line import PortSettings
from drivers.serial_port import SerialPort
from drivers.twin import Twin
from tests.contract.leaping import LeapingLoop
from tests.contract.rigs.arm import settings_for
from tests.drivers.twin import rig
from tests.drivers.twin.rig import POINTING_RAD, STOW_RAD, quintic

BAUD = 1_000_000
MOVE_S = 2.2
RATES = {getattr(termios, f"B{rate}"): rate for rate in (9600, 57600, 115200, 1000000, 2000000, 3000000, 4000000)}


@dataclass
class ArmOnBus:
    """The driver, the emulated servos, the wire between them, and every packet that the host sent."""

    twin: Twin
    emulator: DynamixelEmulator
    wire: PtyWire
    port: SerialPort
    arm: DynamixelArm
    heard: list[Packet] = field(default_factory=list)
    deaf: bool = False
    loses: Callable[[Packet], bool] = lambda packet: False  # packets that do not reach the servos

    def now(self) -> float:
        return asyncio.get_running_loop().time()

    def joints(self) -> tuple[float, ...]:
        self.twin.advance(self.now())
        return tuple(self.twin.joints_rad)


Test = Callable[[ArmOnBus], Awaitable[None]]


def on_bus(
    test: Test,
    *faults: str,
    opened: bool = True,
    emulator: dict[str, Any] | None = None,
    prepare: Callable[[DynamixelEmulator], None] = lambda emulator: None,
    **settings: Any,
) -> None:
    """Run ``test`` on a fresh arm. ``prepare`` does something to the servos before the driver comes."""
    twin = rig.twin(*faults)

    async def main() -> None:
        loop = asyncio.get_running_loop()
        assert isinstance(loop, LeapingLoop)
        paths: list[PtyWire] = []
        servos = DynamixelEmulator(twin, loop.time, host_baud=lambda: rate_of(paths[0].path), **(emulator or {}))
        reader = PacketReader()

        def receive(data: bytes) -> None:
            packets = [item for item in reader.feed(data) if isinstance(item, Packet)]
            bus.heard += packets
            if not bus.deaf and not any(bus.loses(packet) for packet in packets):
                servos.receive(data)

        folder = tempfile.TemporaryDirectory()
        link = Path(folder.name) / "arm"
        wire = PtyWire(BAUD, receive, link)
        paths.append(wire)
        servos.connect(BadLine("arm", twin, loop.time, wire.send, wire.byte_s))
        wire.plug()
        prepare(servos)
        port = SerialPort(PortSettings(str(link), "arm", BAUD, "dynamixel"), loop.time)
        bus = ArmOnBus(twin, servos, wire, port, DynamixelArm(settings_for(twin, **settings), port, loop.time))
        loop.busy = lambda: port.busy or bool(wire.unread)
        serving = asyncio.ensure_future(servos.serve())
        try:
            if opened:
                await bus.arm.open()
            await test(bus)
        finally:
            with suppress(DeviceError):
                await bus.arm.close()
            serving.cancel()
            await asyncio.wait({serving})
            wire.unplug()
            folder.cleanup()

    with asyncio.Runner(loop_factory=LeapingLoop) as runner:
        runner.run(main())


def rate_of(path: str) -> int:
    """The baud rate that the host has set, -1 for an odd one."""
    number = os.open(path, os.O_RDWR | os.O_NOCTTY)
    try:
        return RATES.get(termios.tcgetattr(number)[5], -1)
    finally:
        os.close(number)


def move(start: tuple[float, ...] = STOW_RAD, goal: tuple[float, ...] = POINTING_RAD) -> JointTrajectory:
    times = [0.02 * k for k in range(round(MOVE_S / 0.02) + 1)]
    return JointTrajectory(tuple(times), tuple(quintic(start, goal, MOVE_S, t) for t in times))


NUDGED_RAD = tuple(angle + 0.08 for angle in STOW_RAD)


def nudge() -> JointTrajectory:
    """A little motion of all joints, from the stowed arm."""
    times = [0.02 * k for k in range(31)]
    return JointTrajectory(tuple(times), tuple(quintic(STOW_RAD, NUDGED_RAD, times[-1], t) for t in times))


async def until(condition: Callable[[], bool], longest_s: float = 5.0) -> None:
    end_s = asyncio.get_running_loop().time() + longest_s
    while not condition():
        assert asyncio.get_running_loop().time() < end_s, "waited in vain"
        await asyncio.sleep(0.01)


def apart_rad(a: tuple[float, ...], b: tuple[float, ...]) -> float:
    return max(math.fabs(x - y) for x, y in zip(a, b, strict=True))

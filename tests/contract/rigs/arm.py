"""The Dynamixel driver on emulated servos."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from contextlib import suppress

from drivers.arm.dynamixel import DynamixelArm
from drivers.arm.emulator import DynamixelEmulator, viperx300_joints
from drivers.arm.interface import Arm
from drivers.arm.joints import DynamixelSettings
from drivers.emulation.bad_line import BadLine
from drivers.emulation.wire import PtyWire
from drivers.line import PortSettings
from drivers.serial_port import SerialPort
from drivers.twin import Twin
from tests.contract.rigged import Rigged

BAUD = 1_000_000
WATCHDOG_S = 0.5  # the longest there is, for a machine that many share


def settings_for(twin: Twin, **changes: object) -> DynamixelSettings:
    told: dict[str, object] = {
        "joints": viperx300_joints(twin),
        "max_velocity_rad_s": twin.nominal.joint_velocity_rad_s,
        "max_acceleration_rad_s2": twin.nominal.joint_acceleration_rad_s2,
        "watchdog_s": WATCHDOG_S,
    }
    return DynamixelSettings(**told | changes)  # type: ignore[arg-type]


def emulated_arm(twin: Twin, clock: Callable[[], float]) -> Rigged[Arm]:
    emulator = DynamixelEmulator(twin, clock)
    wire = PtyWire(BAUD, emulator.receive)
    emulator.connect(BadLine("arm", twin, clock, wire.send, wire.byte_s))
    wire.plug()
    port = SerialPort(PortSettings(wire.path, "arm", BAUD, "dynamixel"), clock)
    serving = asyncio.ensure_future(emulator.serve())

    async def end() -> None:
        serving.cancel()
        with suppress(asyncio.CancelledError):
            await serving

    return Rigged(DynamixelArm(settings_for(twin), port, clock), [port], [wire], before_unplugging=end)

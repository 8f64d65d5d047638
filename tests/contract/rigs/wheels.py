"""The production drive on an emulated controller."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from drivers.emulation.bad_line import BadLine
from drivers.emulation.modbus_slave import ModbusSlaves
from drivers.emulation.wire import PtyWire
from drivers.line import PortSettings
from drivers.modbus_master import ModbusMaster
from drivers.serial_port import SerialPort
from drivers.twin import Twin
from drivers.wheels.drive_geometry import Mounting
from drivers.wheels.emulator import Zlac8015dEmulator
from drivers.wheels.interface import Wheels
from drivers.wheels.zlac8015d import Zlac8015dWheels
from drivers.wheels.zlac_settings import Zlac8015dSettings
from tests.contract.rigged import Rigged

BAUD = 115200


@dataclass(frozen=True)
class WheelsRig:
    """Everything between the driver and the twin. ``heard`` is all that the host wrote."""

    twin: Twin
    controller: Zlac8015dEmulator
    slaves: ModbusSlaves
    wire: PtyWire
    port: SerialPort
    master: ModbusMaster
    device: Zlac8015dWheels
    heard: bytearray


def wheels_rig(
    twin: Twin,
    clock: Callable[[], float],
    mounting: Mounting | None = None,
    lacks: frozenset[int] = frozenset(),
    link: Path | None = None,
    **settings: Any,
) -> WheelsRig:
    """``settings`` are the driver's own beside what the machine has."""
    nominal = twin.nominal
    slaves = ModbusSlaves(clock, 10.0 / BAUD)
    heard = bytearray()

    def receive(data: bytes) -> None:
        heard.extend(data)
        slaves.receive(data)

    wire = PtyWire(BAUD, receive, link)
    controller = Zlac8015dEmulator(twin, clock, mounting, lacks=lacks)
    slaves.add(1, controller, BadLine("wheels", twin, clock, wire.send, wire.byte_s))
    wire.plug()
    port = SerialPort(PortSettings(str(link or wire.path), "wheels", BAUD, "modbus"), clock)
    master = ModbusMaster(port)
    told: dict[str, Any] = {
        "radius_m": nominal.wheel_radius_m,
        "track_m": nominal.track_m,
        "max_speed_m_s": nominal.max_speed_m_s,
        "max_acceleration_m_s2": nominal.max_acceleration_m_s2,
        "command_timeout_s": nominal.drive_timeout_s,
    }
    device = Zlac8015dWheels(Zlac8015dSettings(**told | settings), master, clock)
    return WheelsRig(twin, controller, slaves, wire, port, master, device, heard)


def emulated_wheels(twin: Twin, clock: Callable[[], float]) -> Rigged[Wheels]:
    rig = wheels_rig(twin, clock)
    return Rigged(rig.device, (rig.port,), (rig.wire,))

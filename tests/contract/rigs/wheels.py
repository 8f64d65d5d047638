"""The production drive on an emulated controller."""

from __future__ import annotations

from collections.abc import Callable

from drivers.emulation.bad_line import BadLine
from drivers.emulation.wire import PtyWire
from drivers.line import PortSettings
from drivers.modbus_master import ModbusMaster
from drivers.serial_port import SerialPort
from drivers.twin import Twin
from drivers.wheels.emulator import BAUD, WheelsEmulator
from drivers.wheels.zlac8015d import Zlac8015dWheels
from drivers.wheels.zlac_settings import Zlac8015dSettings
from tests.contract.rigged import Rigged


def emulated_wheels(twin: Twin, clock: Callable[[], float]) -> Rigged[Zlac8015dWheels]:
    nominal = twin.nominal
    emulator = WheelsEmulator(twin, clock, 10.0 / BAUD)
    wire = PtyWire(BAUD, emulator.receive)
    emulator.connect(BadLine("wheels", twin, clock, wire.send, wire.byte_s))
    wire.plug()
    port = SerialPort(PortSettings(wire.path, "wheels", BAUD, "modbus"), clock)
    settings = Zlac8015dSettings(
        radius_m=nominal.wheel_radius_m,
        track_m=nominal.track_m,
        max_speed_m_s=nominal.max_speed_m_s,
        max_acceleration_m_s2=nominal.max_acceleration_m_s2,
        command_timeout_s=nominal.drive_timeout_s,
    )
    return Rigged(Zlac8015dWheels(settings, ModbusMaster(port), clock), [port], [wire])

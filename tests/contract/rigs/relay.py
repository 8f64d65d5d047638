"""A Waveshare board on the reference bus, and its driver."""

from __future__ import annotations

from collections.abc import Callable

from drivers.emulation.bad_line import BadLine
from drivers.emulation.modbus_slave import ModbusSlaves
from drivers.emulation.wire import PtyWire
from drivers.line import PortSettings
from drivers.modbus_master import ModbusMaster
from drivers.relay.emulator import emulated_board
from drivers.relay.interface import RelayBoard
from drivers.relay.modbus import ModbusRelay, RelaySettings
from drivers.relay.values import Channel
from drivers.serial_port import SerialPort
from drivers.twin import Twin
from tests.contract.rigged import Rigged

BAUD = 115200
WIRED = {Channel.VALVE: 1, Channel.PUMP: 2, Channel.LAMP: 3, Channel.BEACON: 4}


def emulated_relay(twin: Twin, clock: Callable[[], float]) -> Rigged[RelayBoard]:
    slaves = ModbusSlaves(clock, 10.0 / BAUD)
    wire = PtyWire(BAUD, slaves.receive)
    line = BadLine("relay", twin, clock, wire.send, wire.byte_s)
    slaves.add(1, emulated_board("waveshare-8", 1, twin, clock, WIRED), line)
    wire.plug()
    port = SerialPort(PortSettings(wire.path, "relay", BAUD, "modbus"), clock)
    settings = RelaySettings("waveshare-8", 1, WIRED, longest_pulse_s=twin.nominal.pulse_max_s)
    return Rigged(ModbusRelay(settings, ModbusMaster(port), clock), (port,), (wire,))

"""A Waveshare board on the reference bus, and its driver."""

from __future__ import annotations

from collections.abc import Callable

from drivers.emulation.reference_bus import REFERENCE_BAUD, REFERENCE_BOARD, REFERENCE_WIRING, ReferenceBus
from drivers.line import PortSettings
from drivers.modbus_master import ModbusMaster
from drivers.relay.interface import RelayBoard
from drivers.relay.modbus import ModbusRelay, RelaySettings
from drivers.serial_port import SerialPort
from drivers.twin import Twin
from tests.contract.rigged import Rigged


def emulated_relay(twin: Twin, clock: Callable[[], float]) -> Rigged[RelayBoard]:
    bus = ReferenceBus(twin, clock)
    bus.wire.plug()
    port = SerialPort(PortSettings(bus.wire.path, "relay", REFERENCE_BAUD, "modbus"), clock)
    wired = {channel: number for channel, number in REFERENCE_WIRING.items() if channel in twin.nominal.channels}
    settings = RelaySettings(REFERENCE_BOARD, 1, wired, longest_pulse_s=twin.nominal.pulse_max_s)
    return Rigged(ModbusRelay(settings, ModbusMaster(port), clock), (port,), (bus.wire,))

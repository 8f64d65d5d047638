"""The input modules on the reference bus, and their driver."""

from __future__ import annotations

from collections.abc import Callable

from drivers.emulation.reference_bus import REFERENCE_BAUD, ReferenceBus
from drivers.inputs.interface import Inputs
from drivers.inputs.modbus import InputsSettings, ModbusInputs
from drivers.inputs.profiles import reference_modules, reference_points
from drivers.line import PortSettings
from drivers.modbus_master import ModbusMaster
from drivers.serial_port import SerialPort
from drivers.twin import Twin
from tests.contract.rigged import Rigged


def emulated_inputs(twin: Twin, clock: Callable[[], float]) -> Rigged[Inputs]:
    bus = ReferenceBus(twin, clock)
    bus.wire.plug()
    port = SerialPort(PortSettings(bus.wire.path, "inputs", REFERENCE_BAUD, "modbus"), clock)
    points = reference_points(twin.nominal.tank_ml, twin.nominal.flow_meter_pulses_per_l)
    settings = InputsSettings(reference_modules(), points)
    return Rigged(ModbusInputs(settings, ModbusMaster(port), clock), (port,), (bus.wire,))

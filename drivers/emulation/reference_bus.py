"""The RS-485 bus of the reference rig: the relay board and the input modules behind one wire."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

from drivers.emulation.bad_line import BadLine
from drivers.emulation.modbus_slave import ModbusSlaves
from drivers.emulation.wire import PtyWire
from drivers.inputs.emulator import EmulatedInputs
from drivers.relay.emulator import EmulatedBoard, emulated_board
from drivers.relay.values import Channel
from drivers.twin.machine import Twin

REFERENCE_BAUD = 115200
REFERENCE_BOARD = "waveshare-8"
REFERENCE_WIRING = {
    Channel.VALVE: 1, Channel.PUMP: 2, Channel.LAMP: 3, Channel.BEACON: 4, Channel.CONTACTOR: 5,
}  # fmt: skip


class ReferenceBus:
    """``wire`` is plugged in by whoever made it. ``board`` and ``inputs`` are there for power cycles and cut wires."""

    def __init__(
        self,
        twin: Twin,
        clock: Callable[[], float],
        *,
        baud: int = REFERENCE_BAUD,
        link: Path | None = None,
        profile: str = REFERENCE_BOARD,
        relay_unit: int = 1,
        wired: Mapping[Channel, int] = REFERENCE_WIRING,
        first_count: int = 0,
    ) -> None:
        self.slaves = ModbusSlaves(clock, 10.0 / baud)
        self.wire = PtyWire(baud, self.slaves.receive, link)
        self.board: EmulatedBoard = emulated_board(profile, relay_unit, twin, clock, wired)
        self.inputs = EmulatedInputs(twin, clock, first_count=first_count)
        self.slaves.add(relay_unit, self.board, BadLine("relay", twin, clock, self.wire.send, self.wire.byte_s))
        self.inputs.join(self.slaves, BadLine("inputs", twin, clock, self.wire.send, self.wire.byte_s))

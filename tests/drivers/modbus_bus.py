"""A Modbus bus for tests: our master on one end of a wire, a plain unit of registers and coils on the other."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import TypeVar

from drivers.emulation.bad_line import BadLine
from drivers.emulation.modbus_slave import ILLEGAL_ADDRESS, ILLEGAL_FUNCTION, ModbusException, ModbusSlaves, SlaveUnit
from drivers.emulation.wire import PtyWire
from drivers.line import PortSettings
from drivers.modbus_master import ModbusLine, ModbusMaster
from drivers.serial_port import SerialPort
from tests.drivers.twin import rig

T = TypeVar("T")

BAUD = 115200


def nothing(line: ModbusLine) -> None:
    """A greeting that says nothing."""


class Memory:
    """A unit of 16 coils and 16 registers that keeps every request that it got."""

    def __init__(self) -> None:
        self.coils = [False] * 16
        self.words = [0] * 16
        self.raw_coils: list[tuple[int, int]] = []
        self.heard: list[tuple[int, bytes]] = []
        self.silent = False

    def answer(self, function: int, data: bytes) -> bytes | None:
        self.heard.append((function, data))
        if self.silent:
            return None
        address, count = int.from_bytes(data[:2], "big"), int.from_bytes(data[2:4], "big")
        if function in (1, 2):
            bits = self._of(self.coils, address, count)
            return bytes([(count + 7) // 8]) + packed(bits)
        if function in (3, 4):
            words = self._of(self.words, address, count)
            return bytes([2 * count]) + b"".join(word.to_bytes(2, "big") for word in words)
        if function == 5:
            self._of(self.coils, address, 1)
            self.raw_coils.append((address, count))
            return data
        if function == 6:
            self._of(self.words, address, 1)
            self.words[address] = count
            return data
        if function == 15:
            self._of(self.coils, address, count)
            self.coils[address : address + count] = unpacked(data[5:], count)
            return data[:4]
        if function == 16:
            self._of(self.words, address, count)
            told = [int.from_bytes(data[5 + 2 * i : 7 + 2 * i], "big") for i in range(count)]
            self.words[address : address + count] = told
            return data[:4]
        raise ModbusException(ILLEGAL_FUNCTION)

    @staticmethod
    def _of(memory: list[T], address: int, count: int) -> list[T]:
        if address + count > len(memory):
            raise ModbusException(ILLEGAL_ADDRESS)
        return memory[address : address + count]


def packed(bits: list[bool]) -> bytes:
    return sum(bit << place for place, bit in enumerate(bits)).to_bytes((len(bits) + 7) // 8, "little")


def unpacked(data: bytes, count: int) -> list[bool]:
    number = int.from_bytes(data, "little")
    return [bool(number >> place & 1) for place in range(count)]


class Bus:
    """``units`` by their ids (a list for several with one id) behind a wire, and a master that speaks to them."""

    def __init__(self, *units: tuple[int, SlaveUnit], faults: tuple[str, ...] = (), link: Path | None = None) -> None:
        clock = asyncio.get_running_loop().time
        self.slaves = ModbusSlaves(clock, 10.0 / BAUD)
        self.sent = b""
        self.wire = PtyWire(BAUD, self._receive, link)
        self.line = BadLine("relay", rig.twin(*faults), clock, self.wire.send, self.wire.byte_s)
        for unit_id, unit in units:
            self.slaves.add(unit_id, unit, self.line)
        self.wire.plug()
        path = str(link or self.wire.path)
        self.master = ModbusMaster(SerialPort(PortSettings(path, "bus", BAUD, "modbus"), clock))

    def _receive(self, data: bytes) -> None:
        self.sent += data
        self.slaves.receive(data)


def on_a_bus(
    test: Callable[[Bus], Awaitable[None]], *units: tuple[int, SlaveUnit], faults: tuple[str, ...] = ()
) -> None:
    """Run ``test`` with the master attached."""

    async def main() -> None:
        bus = Bus(*units, faults=faults)
        await bus.master.attach("test", nothing)
        try:
            await test(bus)
        finally:
            await bus.master.detach("test")
            bus.wire.unplug()

    asyncio.run(main())

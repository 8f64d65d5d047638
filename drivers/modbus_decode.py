"""The bytes of a Modbus bus as text: a line for each frame, and for what is none."""

from __future__ import annotations

import struct
from collections.abc import Iterable, Iterator

from drivers import modbus_pdu as pdu
from drivers.byte_trace import Direction
from drivers.modbus_frames import Found, FrameFinder, answer_size, request_size
from drivers.trace_decoder import Wrong

_HEADER = struct.Struct(">HHHB")

_NAMES = {
    pdu.READ_COILS: "read coils",
    pdu.READ_DISCRETE_INPUTS: "read inputs",
    pdu.READ_HOLDING: "read holding",
    pdu.READ_INPUT_REGISTERS: "read input registers",
    pdu.WRITE_COIL: "write coil",
    pdu.WRITE_REGISTER: "write register",
    pdu.WRITE_COILS: "write coils",
    pdu.WRITE_REGISTERS: "write registers",
}


class ModbusDecoder:
    """Fed with the chunks of a trace in order. ``tcp`` for Modbus TCP: a header in place of a checksum.

    What a chunk leaves incomplete is shown with a later one, or once the other side speaks.
    """

    def __init__(self, tcp: bool = False) -> None:
        self._tcp = tcp
        self._finders: dict[Direction, FrameFinder] = {
            "out": FrameFinder(request_size),
            "in": FrameFinder(answer_size),
        }
        self._held: dict[Direction, bytes] = {"out": b"", "in": b""}

    def feed(self, direction: Direction, data: bytes) -> list[str]:
        """The lines for what is complete now; "out" are requests, "in" are answers."""
        if self._tcp:
            return list(self._tcp_lines(direction, data))
        other: Direction = "in" if direction == "out" else "out"
        ended = _lines(other, self._finders[other].silence())
        return ended + _lines(direction, self._finders[direction].feed(data))

    def rest(self) -> list[str]:
        """What never was completed."""
        held, self._held = self._held, {"out": b"", "in": b""}
        incomplete: list[str] = [Wrong(f"incomplete: {data.hex(' ')}") for data in held.values() if data]
        return incomplete + _lines("out", self._finders["out"].silence()) + _lines("in", self._finders["in"].silence())

    def _tcp_lines(self, direction: Direction, data: bytes) -> Iterator[str]:
        held = self._held[direction] + data
        while len(held) >= _HEADER.size:
            transaction, protocol, length, unit = _HEADER.unpack_from(held)
            if protocol != 0 or not 2 <= length <= 254:
                yield Wrong(f"no Modbus TCP: {held.hex(' ')}")
                held = b""
            elif len(held) < 6 + length:
                break
            else:
                payload, held = held[_HEADER.size : 6 + length], held[6 + length :]
                told = _told(unit, payload, direction)
                yield type(told)(f"#{transaction} {told}")
        self._held[direction] = held


def _lines(direction: Direction, found: Iterable[Found]) -> list[str]:
    return [
        _told(each.data[0], each.data[1:-2], direction) if each.is_frame else _broken(direction, each.data)
        for each in found
    ]


def _broken(direction: Direction, data: bytes) -> Wrong:
    return Wrong(f"CRC error in {'a request' if direction == 'out' else 'an answer'}: {data.hex(' ')}")


def _told(unit: int, payload: bytes, direction: Direction) -> str:
    """Unit, function, address and values; a payload begins with its function code."""
    function, data = payload[0], payload[1:]
    name = _NAMES.get(function & ~pdu.ERROR_BIT, f"function {function & ~pdu.ERROR_BIT:02d}")
    to = f"unit {unit} {name}" if unit else f"all units {name}"
    if function & pdu.ERROR_BIT:
        return Wrong(f"{to}: exception {data[0]} ({pdu.exception_name(data[0])})" if data else f"{to}: exception")
    return f"{to}{_values(function, data, direction)}"


def _values(function: int, data: bytes, direction: Direction) -> str:
    if function in pdu.READS and direction == "in":
        if function in (pdu.READ_COILS, pdu.READ_DISCRETE_INPUTS):
            return f" = {' '.join(f'{byte:08b}'[::-1] for byte in data[1:])}"
        return f" = {_words(data[1:])}"
    if len(data) < 4:
        return f" {data.hex(' ')}" if data else ""
    address, second = struct.unpack_from(">HH", data)
    if function in pdu.READS:
        return f" {address:#06x} count {second}"
    if function in (pdu.WRITE_COIL, pdu.WRITE_REGISTER):
        return f" {address:#06x} = {second:#06x}"
    if function in (pdu.WRITE_COILS, pdu.WRITE_REGISTERS):
        told = f" {address:#06x} count {second}"
        if len(data) > 5:
            bits = " ".join(f"{byte:08b}"[::-1] for byte in data[5:])
            told += f" = {bits if function == pdu.WRITE_COILS else _words(data[5:])}"
        return told
    return f" {data.hex(' ')}"


def _words(data: bytes) -> str:
    return " ".join(f"{int.from_bytes(data[place : place + 2], 'big'):#06x}" for place in range(0, len(data), 2))

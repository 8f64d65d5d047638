"""A byte trace of a Modbus bus as lines to read: one for each frame, with what no frame holds together named too."""

from __future__ import annotations

import struct
from collections.abc import Iterable, Iterator

from drivers import modbus_pdu as pdu
from drivers.byte_trace import Chunk, Direction
from drivers.modbus_frames import Found, FrameFinder, answer_size, request_size

LONGEST_SILENCE_S = 0.05
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
    """Takes chunks as they come. ``tcp`` for Modbus TCP, whose frames have a header in place of a checksum."""

    def __init__(self, tcp: bool = False) -> None:
        self._tcp = tcp
        self._finders: dict[Direction, FrameFinder] = {
            "out": FrameFinder(request_size),
            "in": FrameFinder(answer_size),
        }
        self._held: dict[Direction, bytes] = {"out": b"", "in": b""}
        self._stamp_s: dict[Direction, float] = {"out": 0.0, "in": 0.0}

    def feed(self, chunk: Chunk) -> list[str]:
        """The lines of the frames that end in this chunk."""
        direction, other = chunk.direction, _other(chunk.direction)
        if self._tcp:
            return list(self._tcp_lines(chunk))
        lines = self._flushed(other)
        if chunk.stamp_s - self._stamp_s[direction] > LONGEST_SILENCE_S:
            lines += self._flushed(direction)
        self._stamp_s[direction] = chunk.stamp_s
        return lines + _lines(chunk.stamp_s, direction, self._finders[direction].feed(chunk.data))

    def end(self) -> list[str]:
        """What was begun and not completed."""
        if self._tcp:
            directions: tuple[Direction, ...] = ("out", "in")
            rest = [(direction, self._held[direction]) for direction in directions if self._held[direction]]
            self._held = {"out": b"", "in": b""}
            return [
                _line(self._stamp_s[direction], direction, f"incomplete: {data.hex(' ')}") for direction, data in rest
            ]
        return self._flushed("out") + self._flushed("in")

    def _flushed(self, direction: Direction) -> list[str]:
        return _lines(self._stamp_s[direction], direction, self._finders[direction].silence())

    def _tcp_lines(self, chunk: Chunk) -> Iterator[str]:
        direction = chunk.direction
        self._stamp_s[direction] = chunk.stamp_s
        held = self._held[direction] + chunk.data
        while len(held) >= _HEADER.size:
            transaction, protocol, length, unit = _HEADER.unpack_from(held)
            if protocol != 0 or not 2 <= length <= 254:
                yield _line(chunk.stamp_s, direction, f"no Modbus TCP: {held.hex(' ')}")
                held = b""
            elif len(held) < 6 + length:
                break
            else:
                payload, held = held[_HEADER.size : 6 + length], held[6 + length :]
                text = f"#{transaction} {_told(unit, payload, direction)}"
                yield _line(chunk.stamp_s, direction, text)
        self._held[direction] = held


def decode(chunks: Iterable[Chunk], tcp: bool = False) -> Iterator[str]:
    """All the lines of a trace."""
    decoder = ModbusDecoder(tcp)
    for chunk in chunks:
        yield from decoder.feed(chunk)
    yield from decoder.end()


def _other(direction: Direction) -> Direction:
    return "in" if direction == "out" else "out"


def _lines(stamp_s: float, direction: Direction, found: Iterable[Found]) -> list[str]:
    return [
        _line(
            stamp_s,
            direction,
            _told(each.data[0], each.data[1:-2], direction) if each.is_frame else f"CRC error: {each.data.hex(' ')}",
        )
        for each in found
    ]


def _line(stamp_s: float, direction: Direction, text: str) -> str:
    return f"{stamp_s:12.6f} {'>' if direction == 'out' else '<'} {text}"


def _told(unit: int, payload: bytes, direction: Direction) -> str:
    """Unit, function, address and values; a payload begins with its function code."""
    function, data = payload[0], payload[1:]
    name = _NAMES.get(function & ~pdu.ERROR_BIT, f"function {function & ~pdu.ERROR_BIT:02d}")
    to = f"unit {unit} {name}" if unit else f"all units {name}"
    if function & pdu.ERROR_BIT:
        return f"{to}: exception {data[0]} ({pdu.exception_name(data[0])})" if data else f"{to}: exception"
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

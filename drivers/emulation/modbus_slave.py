"""The units of an emulated RS-485 bus: they hear the same frames and answer each for itself."""

from __future__ import annotations

import asyncio
import struct
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from drivers.emulation.bad_line import BadLine
from drivers.modbus_frames import ERROR_BIT, FrameFinder, request_size, with_crc

BROADCAST = 0
SILENT_CHARACTERS = 3.5
SHORTEST_SILENCE_S = 0.005  # the host's bytes pass a scheduler, which may pause between two of them
TURNAROUND_S = 0.0015

ILLEGAL_FUNCTION, ILLEGAL_ADDRESS, ILLEGAL_VALUE, DEVICE_FAILURE = 1, 2, 3, 4


class ModbusException(Exception):
    """The unit's answer is the exception ``code``."""

    def __init__(self, code: int) -> None:
        super().__init__(f"exception {code}")
        self.code = code


class SlaveUnit(Protocol):
    """What stands behind a unit id."""

    def answer(self, function: int, data: bytes) -> bytes | None:
        """The answer's data to a request's data, both after the function code; None to keep silent.

        Raises ``ModbusException``. Writes may come by broadcast: then what is answered is not sent.
        """
        ...


@dataclass(frozen=True, slots=True)
class _Member:
    unit_id: int
    unit: SlaveUnit
    line: BadLine
    turnaround_s: float


class ModbusSlaves:
    """One or more units behind one wire: checksums, silence between frames, broadcast, strict lengths.

    Two units may be given one id, as a careless installer would: then both answer.
    """

    def __init__(self, clock: Callable[[], float], byte_s: float) -> None:
        self._clock, self._byte_s = clock, byte_s
        self._silence_s = max(SILENT_CHARACTERS * byte_s, SHORTEST_SILENCE_S)
        self._finder = FrameFinder(request_size)
        self._members: list[_Member] = []
        self._heard_s = 0.0
        self._timer: asyncio.TimerHandle | None = None
        self.broken_bytes = 0

    def add(self, unit_id: int, unit: SlaveUnit, line: BadLine, turnaround_s: float = TURNAROUND_S) -> None:
        """``turnaround_s``: from the end of a request to the beginning of the answer."""
        if not 1 <= unit_id <= 255:
            raise ValueError(f"modbus: expected a unit id of 1 to 255, found {unit_id}; correct it")
        self._members.append(_Member(unit_id, unit, line, turnaround_s))

    def receive(self, data: bytes) -> None:
        """What has just passed the wire."""
        now_s = self._clock()
        if now_s - len(data) * self._byte_s - self._heard_s > self._silence_s:
            self._silence()
        self._heard_s = now_s
        for found in self._finder.feed(data):
            self._hear(found.data, found.is_frame)
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        if self._finder.held:
            self._timer = asyncio.get_running_loop().call_later(self._silence_s, self._silence)

    def _silence(self) -> None:
        for found in self._finder.silence():
            self._hear(found.data, found.is_frame)

    def _hear(self, frame: bytes, is_frame: bool) -> None:
        if not is_frame:
            self.broken_bytes += len(frame)
            return
        unit_id, function, data = frame[0], frame[1], frame[2:-2]
        for member in self._members:
            if unit_id in (member.unit_id, BROADCAST) and member.line.hears:
                answer = _answer(member.unit, function, data)
                if answer is not None and unit_id != BROADCAST:
                    whole = with_crc(bytes([member.unit_id]) + answer)
                    member.line.say(whole, member.turnaround_s, len(frame))


def _answer(unit: SlaveUnit, function: int, data: bytes) -> bytes | None:
    """Function code and data of the answer."""
    try:
        _require_well_formed(function, data)
        answer = unit.answer(function, data)
    except ModbusException as exception:
        return bytes([function | ERROR_BIT, exception.code])
    return None if answer is None else bytes([function]) + answer


def _require_well_formed(function: int, data: bytes) -> None:
    """Counts that fit the data, as the standard has them (Application Protocol V1.1b3, section 6)."""
    count = int.from_bytes(data[2:4], "big")
    if function in (1, 2):
        fits = 1 <= count <= 2000
    elif function in (3, 4):
        fits = 1 <= count <= 125
    elif function == 15:
        fits = 1 <= count <= 1968 and data[4] == (count + 7) // 8
    elif function == 16:
        fits = 1 <= count <= 123 and data[4] == 2 * count
    else:
        fits = True
    if not fits:
        raise ModbusException(ILLEGAL_VALUE)


class TcpSlaves:
    """Units behind a Modbus TCP device or gateway: a header with a transaction number instead of a checksum."""

    HEADER = struct.Struct(">HHHB")

    def __init__(self) -> None:
        self._members: list[_Member] = []
        self._held = b""

    def add(self, unit_id: int, unit: SlaveUnit, line: BadLine, turnaround_s: float = TURNAROUND_S) -> None:
        """``turnaround_s``: from the request to the answer."""
        self._members.append(_Member(unit_id, unit, line, turnaround_s))

    def receive(self, data: bytes) -> None:
        """What has just come over the connection."""
        self._held += data
        while len(self._held) >= self.HEADER.size:
            transaction, protocol, length, unit_id = self.HEADER.unpack_from(self._held)
            if protocol != 0 or not 2 <= length <= 254:
                self._held = b""
                return
            if len(self._held) < 6 + length:
                return
            payload, self._held = self._held[self.HEADER.size : 6 + length], self._held[6 + length :]
            self._hear(transaction, unit_id, payload)

    def _hear(self, transaction: int, unit_id: int, payload: bytes) -> None:
        for member in self._members:
            if unit_id == member.unit_id and member.line.hears:
                if not _sized(payload):
                    continue
                answer = _answer(member.unit, payload[0], payload[1:])
                if answer is not None:
                    head = self.HEADER.pack(transaction, 0, len(answer) + 1, unit_id)
                    member.line.say(head + answer, member.turnaround_s, len(payload))


def _sized(payload: bytes) -> bool:
    """Whether a request without checksum has the length of its function."""
    size = request_size(b"\0" + payload)
    return size == 0 or size == len(payload) + 3

"""How a Modbus request goes over a line and its answer comes back: RTU frames, or the frames of Modbus TCP.

Both put no trust in what comes in: late answers are thrown away before each request, and an answer counts only with the
right unit, function, length, checksum and echo.
"""

from __future__ import annotations

import struct
import time
from typing import Protocol

from pymodbus.framer import FramerRTU, FramerSocket
from pymodbus.pdu import DecodePDU

from drivers.line import Line
from drivers.modbus_frames import with_crc
from drivers.modbus_pdu import ERROR_BIT, Request

SILENT_CHARACTERS = 3.5
SHORTEST_SILENCE_S = 0.00175  # fixed above 19200 baud (Modbus over Serial Line V1.02, 2.5.1.1)
CHUNK_PAUSE_S = 0.004  # USB adapters hand bytes over in lumps
LONGEST_DRAIN_S = 0.1  # a line that is never silent is spoken into all the same
EXCEPTION_BYTES = 5
HEADER = struct.Struct(">HHHB")


class Silence(Exception):
    """No byte came in time."""


class Garbled(Exception):
    """Something came that is no answer to the request."""

    def __init__(self, why: str, data: bytes) -> None:
        super().__init__(f"{why}: {data.hex(' ')}" if data else why)
        self.data = data


class Framing(Protocol):
    """One conversation over one opened line."""

    def exchange(self, unit_id: int, request: Request, timeout_s: float) -> bytes:
        """The answer's function code and data. ``Silence``, ``Garbled``; ``OSError`` when the line is gone.

        ``timeout_s`` is the device's time to think; the time on the wire is added.
        """
        ...

    def listen(self, for_s: float) -> bytes:
        """What comes in unasked within ``for_s``."""
        ...


class RtuFraming:
    """Modbus RTU: unit id, function, data, CRC; frames are parted by silence."""

    def __init__(self, line: Line) -> None:
        self._line = line
        self._framer = FramerRTU(DecodePDU(is_server=False))
        self._byte_s = line.settings.byte_s
        self._silence_s = max(SILENT_CHARACTERS * self._byte_s, SHORTEST_SILENCE_S)
        self._active_s = time.monotonic()  # when the last byte was seen
        self._late: tuple[int, int] = (0, 0)  # unit and function whose answer did not come
        self._late_until_s = 0.0

    def exchange(self, unit_id: int, request: Request, timeout_s: float) -> bytes:
        self._quiet(unit_id, request)
        frame = self._framer.encode(request.payload, unit_id, 0)
        self._line.write(frame)
        size = request.answer_bytes + 3
        deadline_s = time.monotonic() + (len(frame) + size) * self._byte_s + timeout_s
        try:
            return self._checked(self._read(size, deadline_s), unit_id, request)
        except (Silence, Garbled):
            self._late, self._late_until_s = (unit_id, request.function), time.monotonic() + timeout_s
            raise
        finally:
            self._active_s = time.monotonic()

    def listen(self, for_s: float) -> bytes:
        heard = self._line.read_some(for_s)
        self._active_s = time.monotonic()
        return heard

    def _quiet(self, unit_id: int, request: Request) -> None:
        """Silence before the request. A read waits for a missed answer that could be taken for its own."""
        wait_s = self._late_until_s - time.monotonic()
        if wait_s > 0.0 and request.reads and self._late == (unit_id, request.function):
            self._line.read_some(wait_s)
            self._active_s, self._late_until_s = time.monotonic(), 0.0
        rest_s = self._active_s + self._silence_s - time.monotonic()
        self._line.drain(max(0.0, rest_s), LONGEST_DRAIN_S)

    def _read(self, size: int, deadline_s: float) -> bytes:
        """A frame of ``size`` bytes, or an exception reply; less when no more came."""
        head = self._line.read(min(EXCEPTION_BYTES, size), deadline_s - time.monotonic())
        if not head:
            raise Silence
        if len(head) < EXCEPTION_BYTES or head[1] & ERROR_BIT:
            return head
        return head + self._line.read(size - len(head), deadline_s - time.monotonic())

    def _checked(self, frame: bytes, unit_id: int, request: Request) -> bytes:
        why = self._flaw(frame, unit_id, request)
        if why:
            raise Garbled(why, frame + self._line.drain(max(self._silence_s, CHUNK_PAUSE_S), LONGEST_DRAIN_S))
        return frame[1:-2]

    def _flaw(self, frame: bytes, unit_id: int, request: Request) -> str:
        if len(frame) < EXCEPTION_BYTES:
            return "too short"
        if not FramerRTU.check_CRC(frame[:-2], int.from_bytes(frame[-2:], "big")):
            return "wrong checksum or length"
        if frame[0] != unit_id:
            return f"of unit {frame[0]}"
        if self._line.waiting():
            return "more bytes than an answer has"
        return flaw(frame[1:-2], request)


class TcpFraming:
    """Modbus TCP: a header with a transaction number, so that a late answer is known as one."""

    def __init__(self, line: Line) -> None:
        self._line = line
        self._framer = FramerSocket(DecodePDU(is_server=False))
        self._transaction = 0

    def exchange(self, unit_id: int, request: Request, timeout_s: float) -> bytes:
        self._line.drain()
        self._transaction = self._transaction % 0xFFFF + 1
        self._line.write(self._framer.encode(request.payload, unit_id, self._transaction))
        deadline_s = time.monotonic() + timeout_s
        while True:
            transaction, unit, payload = self._read(deadline_s)
            if transaction == self._transaction:
                break
        why = f"of unit {unit}" if unit != unit_id else flaw(payload, request)
        if why:
            raise Garbled(why, payload + self._line.drain(CHUNK_PAUSE_S, LONGEST_DRAIN_S))
        return payload

    def listen(self, for_s: float) -> bytes:
        return self._line.read_some(for_s)

    def _read(self, deadline_s: float) -> tuple[int, int, bytes]:
        head = self._line.read(HEADER.size, deadline_s - time.monotonic())
        if not head:
            raise Silence
        if len(head) < HEADER.size:
            raise Garbled("too short", head)
        transaction, protocol, length, unit = HEADER.unpack(head)
        if protocol != 0 or not 3 <= length <= 254:
            raise Garbled("no header of Modbus TCP", head + self._line.drain(CHUNK_PAUSE_S, LONGEST_DRAIN_S))
        payload = self._line.read(length - 1, deadline_s - time.monotonic())
        if len(payload) < length - 1:
            raise Garbled("too short", head + payload)
        return transaction, unit, payload


def rtu_frame(unit_id: int, request: Request) -> bytes:
    """A request as it goes over a serial line."""
    return with_crc(bytes([unit_id]) + request.payload)


def tcp_frame(unit_id: int, request: Request) -> bytes:
    """A request as it goes over TCP, under the transaction number 0, which no other request has."""
    return HEADER.pack(0, 0, len(request.payload) + 1, unit_id) + request.payload


def flaw(payload: bytes, request: Request) -> str:
    """Why ``payload`` answers something else than ``request``, "" when it does or is an exception reply to it."""
    function = payload[0]
    if function == request.function | ERROR_BIT and len(payload) == 2:
        return ""
    if function != request.function:
        return f"of function {function}"
    if len(payload) != request.answer_bytes:
        return f"of {len(payload)} bytes where {request.answer_bytes} were due"
    return "" if request.answered_by(payload) else "with another echo"

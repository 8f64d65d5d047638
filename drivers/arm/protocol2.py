"""Dynamixel Protocol 2.0 packets as bytes: building, and a strict reader of a stream of them.

The bus' own view of itself, for the emulated servos and for decoding; the driver speaks through the maker's SDK.
Source: ROBOTIS e-Manual, "Protocol 2.0".
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

HEADER = b"\xff\xff\xfd\x00"
BROADCAST = 0xFE
HIGHEST_ID = 252
ALERT = 0x80  # in the error byte of a status packet: register 70 is not 0
LONGEST_BODY = 1024
STUFFED, _PLAIN = b"\xff\xff\xfd\xfd", b"\xff\xff\xfd"
_BEFORE_BODY = 7  # header, id, length


class Instruction(IntEnum):
    PING = 0x01
    READ = 0x02
    WRITE = 0x03
    REG_WRITE = 0x04
    ACTION = 0x05
    FACTORY_RESET = 0x06
    REBOOT = 0x08
    CLEAR = 0x10
    CONTROL_TABLE_BACKUP = 0x20
    STATUS = 0x55
    SYNC_READ = 0x82
    SYNC_WRITE = 0x83
    FAST_SYNC_READ = 0x8A
    BULK_READ = 0x92
    BULK_WRITE = 0x93
    FAST_BULK_READ = 0x9A


class StatusError(IntEnum):
    """The lower seven bits of a status packet's error byte."""

    NONE = 0
    RESULT_FAIL = 1
    INSTRUCTION = 2
    CRC = 3
    DATA_RANGE = 4
    DATA_LENGTH = 5
    DATA_LIMIT = 6
    ACCESS = 7


STATUS_ERROR_TEXTS = {
    StatusError.NONE: "no error",
    StatusError.RESULT_FAIL: "could not be done",
    StatusError.INSTRUCTION: "unknown instruction",
    StatusError.CRC: "checksum error",
    StatusError.DATA_RANGE: "value out of range",
    StatusError.DATA_LENGTH: "wrong length",
    StatusError.DATA_LIMIT: "value beyond the limit",
    StatusError.ACCESS: "no access",
}


def status_error_text(error: int) -> str:
    """What the lower bits of an error byte say."""
    number = error & ~ALERT
    try:
        return STATUS_ERROR_TEXTS[StatusError(number)]
    except ValueError:
        return f"error {number}"


def _crc_table() -> tuple[int, ...]:
    """CRC-16 with polynomial 0x8005, most significant bit first."""
    table = []
    for high in range(256):
        crc = high << 8
        for _ in range(8):
            crc = (crc << 1 ^ 0x8005 if crc & 0x8000 else crc << 1) & 0xFFFF
        table.append(crc)
    return tuple(table)


_CRC_TABLE = _crc_table()


def crc16(data: bytes, crc: int = 0) -> int:
    """Over ``data``, going on from ``crc``."""
    table = _CRC_TABLE
    for byte in data:
        crc = (crc << 8 & 0xFFFF) ^ table[crc >> 8 ^ byte]
    return crc


def packet(servo_id: int, instruction: int, data: bytes = b"") -> bytes:
    """A whole packet, stuffed, with length and CRC. ``data`` begins after the instruction (in a status: the error)."""
    body = stuff(bytes([instruction]) + data)
    head = HEADER + bytes([servo_id]) + (len(body) + 2).to_bytes(2, "little")
    return head + body + crc16(head + body).to_bytes(2, "little")


def status(servo_id: int, error: int, data: bytes = b"") -> bytes:
    return packet(servo_id, Instruction.STATUS, bytes([error]) + data)


def stuff(body: bytes) -> bytes:
    """An FD after every FF FF FD, so that no body holds a header."""
    return body.replace(_PLAIN, STUFFED)


@dataclass(frozen=True, slots=True)
class Packet:
    """A packet that came through. ``data`` is what follows the instruction, unstuffed."""

    servo_id: int
    instruction: int
    data: bytes
    wire_bytes: int


@dataclass(frozen=True, slots=True)
class Broken:
    """A packet whose CRC or stuffing is wrong. ``servo_id`` may itself be wrong."""

    servo_id: int
    instruction: int
    because: str
    wire_bytes: int


@dataclass(frozen=True, slots=True)
class Noise:
    """Bytes outside any packet."""

    data: bytes


class PacketReader:
    """Finds packets in a stream of bytes, however it is cut up. Holds at most one packet and a piece of a header.

    A status to a fast sync read carries several CRCs; its last one covers all and is checked like any other. Its body
    is not stuffed.
    """

    def __init__(self) -> None:
        self._held = bytearray()

    @property
    def held_bytes(self) -> int:
        """Of a packet that is not complete."""
        return len(self._held)

    @property
    def held(self) -> bytes:
        return bytes(self._held)

    def feed(self, data: bytes) -> list[Packet | Broken | Noise]:
        """What is complete with ``data``."""
        self._held += data
        found: list[Packet | Broken | Noise] = []
        while True:
            self._skip_noise(found)
            held = self._held
            if len(held) < _BEFORE_BODY:
                return found
            length = held[5] | held[6] << 8
            if not 3 <= length <= LONGEST_BODY:
                self._give_up_header(found)
                continue
            whole = _BEFORE_BODY + length
            later = held.find(HEADER, 1, whole - 2)
            if later > 0 and not _may_hold_headers(held):  # cut short: the next packet has begun
                found.append(Noise(bytes(held[:later])))
                del held[:later]
                continue
            if len(held) < whole:
                return found
            found.append(_open(bytes(held[:whole])))
            if isinstance(found[-1], Broken) and found[-1].because == "the checksum is wrong":
                self._after_bad_checksum(whole)
            else:
                del held[:whole]

    def _skip_noise(self, found: list[Packet | Broken | Noise]) -> None:
        """Up to a header, or to what may become one."""
        held = self._held
        start = held.find(HEADER)
        if start < 0:
            start = len(held) - next((k for k in (3, 2, 1) if held.endswith(HEADER[:k])), 0)
        if start:
            found.append(Noise(bytes(held[:start])))
            del held[:start]

    def _give_up_header(self, found: list[Packet | Broken | Noise]) -> None:
        found.append(Noise(bytes(self._held[: len(HEADER)])))
        del self._held[: len(HEADER)]

    def _after_bad_checksum(self, whole: int) -> None:
        """The length itself may have been wrong: go on at the next header inside, if there is one."""
        inside = self._held.find(HEADER, 1, whole)
        del self._held[: inside if inside > 0 else whole]


def _may_hold_headers(held: bytearray) -> bool:
    """The body of a fast read's status is not stuffed: what looks like a header may be data."""
    return held[4] == BROADCAST and len(held) > _BEFORE_BODY and held[7] == Instruction.STATUS


def _open(raw: bytes) -> Packet | Broken:
    servo_id, instruction, size = raw[4], raw[7], len(raw)
    if crc16(raw[:-2]) != raw[-2] | raw[-1] << 8:
        return Broken(servo_id, instruction, "the checksum is wrong", size)
    body = raw[_BEFORE_BODY:-2]
    if servo_id == BROADCAST and instruction == Instruction.STATUS:
        return Packet(servo_id, instruction, body[1:], size)
    plain = body.replace(STUFFED, _PLAIN)
    if stuff(plain) != body:
        return Broken(servo_id, instruction, "FF FF FD stands unstuffed in it", size)
    return Packet(servo_id, instruction, plain[1:], size)

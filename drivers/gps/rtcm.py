"""Frames of RTCM 3 (standard 10403): preamble D3, ten bits of length, payload, CRC-24Q."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

PREAMBLE = 0xD3
LONGEST_PAYLOAD = 1023
_POLYNOMIAL = 0x1864CFB


@cache
def _table() -> tuple[int, ...]:
    values = []
    for byte in range(256):
        crc = byte << 16
        for _ in range(8):
            crc = (crc << 1) ^ (_POLYNOMIAL if crc & 0x800000 else 0)
        values.append(crc & 0xFFFFFF)
    return tuple(values)


def crc24q(data: bytes) -> int:
    table, crc = _table(), 0
    for byte in data:
        crc = ((crc << 8) & 0xFFFFFF) ^ table[(crc >> 16) ^ byte]
    return crc


def frame(payload: bytes) -> bytes:
    """A payload with preamble, length and checksum. ``ValueError`` when it is too long."""
    if len(payload) > LONGEST_PAYLOAD:
        raise ValueError(f"RTCM: expected at most {LONGEST_PAYLOAD} bytes, found {len(payload)}; split the message")
    head = bytes([PREAMBLE]) + len(payload).to_bytes(2, "big") + payload
    return head + crc24q(head).to_bytes(3, "big")


def message_number(rtcm: bytes) -> int:
    """The message type of a frame (its first twelve bits), 0 of an empty one."""
    return int.from_bytes(rtcm[3:5], "big") >> 4 if len(rtcm) >= 8 else 0


@dataclass(slots=True)
class RtcmStatistics:
    """``bad_checksums`` counts beginnings that were no frame; ``stray_bytes`` belong to no frame."""

    bytes: int = 0
    frames: int = 0
    bad_checksums: int = 0
    stray_bytes: int = 0


class RtcmFramer:
    """Frames in a stream of any bytes. Holds less than one frame back; how the bytes are split is no matter."""

    def __init__(self) -> None:
        self.statistics = RtcmStatistics()
        self._held = b""

    def feed(self, data: bytes) -> list[bytes]:
        """The frames that are complete now and whose checksum is right."""
        statistics = self.statistics
        statistics.bytes += len(data)
        data = self._held + data
        frames: list[bytes] = []
        place = 0
        while True:
            begin = data.find(PREAMBLE, place)
            if begin < 0:
                statistics.stray_bytes += len(data) - place
                self._held = b""
                return frames
            statistics.stray_bytes += begin - place
            place = begin
            if len(data) - begin < 3:
                break
            length = int.from_bytes(data[begin + 1 : begin + 3], "big")
            if length > LONGEST_PAYLOAD:  # six bits are reserved and zero
                statistics.stray_bytes += 1
                place = begin + 1
                continue
            end = begin + 6 + length
            if len(data) < end:
                break
            if crc24q(data[begin:end]) == 0:  # the checksum of all with its checksum
                statistics.frames += 1
                frames.append(data[begin:end])
                place = end
            else:
                statistics.bad_checksums += 1
                statistics.stray_bytes += 1
                place = begin + 1
        self._held = data[place:]
        return frames

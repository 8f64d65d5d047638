"""Finds Modbus RTU frames in a stream of bytes, whatever stands between them and however the stream is cut."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from pymodbus.framer import FramerRTU

LONGEST_BYTES = 256
ERROR_BIT = 0x80

Size = Callable[[bytes | bytearray], int | None]


@dataclass(frozen=True, slots=True)
class Found:
    """A frame with its CRC, or bytes that belong to none."""

    data: bytes
    is_frame: bool


def request_size(head: bytes | bytearray) -> int | None:
    """Bytes of the request frame that begins so: None when more must be seen, 0 for an unknown function."""
    if len(head) < 2:
        return None
    if head[1] in (1, 2, 3, 4, 5, 6):
        return 8
    if head[1] in (15, 16):
        return None if len(head) < 7 else 9 + head[6]
    return 0


def answer_size(head: bytes | bytearray) -> int | None:
    """The same for an answer frame."""
    if len(head) < 2:
        return None
    if head[1] in (1, 2, 3, 4):
        return None if len(head) < 3 else 5 + head[2]
    if head[1] in (5, 6, 15, 16):
        return 8
    return 5 if head[1] & ERROR_BIT else 0


class FrameFinder:
    """Of the frames with a right checksum that overlap, the one that ends first counts."""

    def __init__(self, size: Size) -> None:
        self._size = size
        self._held = bytearray()
        self._unsized: list[int] = []  # beginnings whose size is not known yet
        self._ends: dict[int, list[int]] = {}  # end -> beginnings

    @property
    def held(self) -> int:
        """Bytes that wait for more."""
        return len(self._held)

    def feed(self, data: bytes) -> list[Found]:
        found: list[Found] = []
        for byte in data:
            self._held.append(byte)
            self._unsized.append(len(self._held) - 1)
            self._learn_sizes()
            begin = self._whole_frame()
            if begin is not None:
                found += self._take(begin)
            elif len(self._held) > LONGEST_BYTES:
                found.append(self._drop(len(self._held) - LONGEST_BYTES))
        return found

    def silence(self) -> list[Found]:
        """The line was silent: what was begun will not be completed. Unknown functions are known by this only."""
        if not self._held:
            return []
        held = bytes(self._held)
        self._clear()
        return [Found(held, len(held) >= 4 and valid(held))]

    def _learn_sizes(self) -> None:
        waiting = []
        for begin in self._unsized:
            size = self._size(self._held[begin : begin + 7])
            if size is None:
                waiting.append(begin)
            elif 0 < size <= LONGEST_BYTES:
                self._ends.setdefault(begin + size, []).append(begin)
        self._unsized = waiting

    def _whole_frame(self) -> int | None:
        begins = self._ends.pop(len(self._held), ())
        return next((begin for begin in begins if valid(bytes(self._held[begin:]))), None)

    def _take(self, begin: int) -> list[Found]:
        before, frame = bytes(self._held[:begin]), bytes(self._held[begin:])
        self._clear()
        return ([Found(before, False)] if before else []) + [Found(frame, True)]

    def _drop(self, count: int) -> Found:
        dropped = bytes(self._held[:count])
        del self._held[:count]
        self._unsized = [begin - count for begin in self._unsized if begin >= count]
        ends = self._ends.items()
        self._ends = {end - count: [begin - count for begin in begins if begin >= count] for end, begins in ends}
        return Found(dropped, False)

    def _clear(self) -> None:
        self._held.clear()
        self._unsized.clear()
        self._ends.clear()


def valid(frame: bytes) -> bool:
    """Whether the last two bytes are the checksum of the others."""
    return bool(FramerRTU.check_CRC(frame[:-2], int.from_bytes(frame[-2:], "big")))


def with_crc(frame: bytes) -> bytes:
    return frame + FramerRTU.compute_CRC(frame).to_bytes(2, "big")

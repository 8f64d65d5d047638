"""What a serial receiver makes of bytes that were sent at another rate than its own (8N1)."""

from __future__ import annotations

import fcntl
import struct

ALIKE = 0.03  # how far two rates may differ and still understand each other
_BITS = 10  # start, eight data, stop

# asm-generic/termbits.h: termios2 has the rates as numbers, which termios lacks
_TCGETS2, _TCSETS2 = 0x802C542A, 0x402C542B
_BOTHER, _CBAUD, _CBAUD_SHIFT = 0o010000, 0o010017, 16
_TERMIOS2 = struct.Struct("@4I20s2I")


def host_baud(descriptor: int) -> int:
    """The rate that is set on a terminal."""
    return int(_TERMIOS2.unpack(fcntl.ioctl(descriptor, _TCGETS2, bytes(_TERMIOS2.size)))[6])


def set_host_baud(descriptor: int, baud: int) -> None:
    """Any rate, both ways."""
    fields = list(_TERMIOS2.unpack(fcntl.ioctl(descriptor, _TCGETS2, bytes(_TERMIOS2.size))))
    fields[2] = (fields[2] & ~(_CBAUD | _CBAUD << _CBAUD_SHIFT)) | _BOTHER | _BOTHER << _CBAUD_SHIFT
    fields[5] = fields[6] = baud
    fcntl.ioctl(descriptor, _TCSETS2, _TERMIOS2.pack(*fields))


def misheard(data: bytes, sent_baud: int, heard_baud: int) -> bytes:
    """``data``, sent without a pause, as a receiver at ``heard_baud`` samples it. A broken frame is read as 0."""
    if abs(sent_baud - heard_baud) <= ALIKE * heard_baud:
        return data
    levels = [1, *(level for byte in data for level in (0, *(byte >> k & 1 for k in range(8)), 1))]
    bits_each = sent_baud / heard_baud  # of the sender, in a bit of the receiver
    heard, at = bytearray(), 0.0
    while (start := _falling(levels, int(at))) is not None:
        samples = [_level(levels, start + (k + 0.5) * bits_each) for k in range(_BITS)]
        if samples[0] == 1:  # shorter than half a bit is no start
            at = start + 1.0
            continue
        whole = samples[-1] == 1
        heard.append(sum(bit << k for k, bit in enumerate(samples[1:9])) if whole else 0)
        at = start + (_BITS - 0.5) * bits_each
    return bytes(heard)


def _level(levels: list[int], at: float) -> int:
    """The line at a moment; it is high when nobody sends."""
    place = int(at)
    return levels[place] if place < len(levels) else 1


def _falling(levels: list[int], place: int) -> int | None:
    """The next bit in which the line is low after it was high."""
    while place + 1 < len(levels):
        if levels[place] == 1 and levels[place + 1] == 0:
            return place + 1
        place += 1
    return None

"""NMEA 0183 sentences in a stream of any bytes: halves, floods, merged sentences, missing line ends."""

from __future__ import annotations

import re
from dataclasses import dataclass

LONGEST_BYTES = 255  # NMEA allows 82; receivers send longer ones

_BODY = rb"[\x20-\x23\x25-\x29\x2b-\x7e]"  # printable without $ and *
_FRAME = re.compile(rb"\$%b{5,%d}\*[0-9A-Fa-f]{2}" % (_BODY, LONGEST_BYTES - 4))
_BEGUN = re.compile(rb"\$%b{0,%d}(\*[0-9A-Fa-f]?)?\Z" % (_BODY, LONGEST_BYTES - 4))


@dataclass(slots=True)
class FramingStatistics:
    """``stray_bytes`` belong to no frame and no line end."""

    bytes: int = 0
    frames: int = 0
    stray_bytes: int = 0


class Framer:
    """Cuts ``$...*hh`` out of what comes. Holds at most ``LONGEST_BYTES`` back; how bytes are split is no matter."""

    def __init__(self) -> None:
        self.statistics = FramingStatistics()
        self.held = b""  # the beginning of a frame that waits for its rest

    def feed(self, data: bytes) -> list[tuple[int, bytes]]:
        """The frames that are complete now, without line ends; their checksums are not looked at.

        Each with the place of its ``$`` in ``data``, negative when it came before.
        """
        self.statistics.bytes += len(data)
        earlier = len(self.held)
        data = self.held + data
        frames, end = [], 0
        for match in _FRAME.finditer(data):
            frames.append((match.start() - earlier, match.group()))
            self.statistics.stray_bytes += _stray(data[end : match.start()])
            end = match.end()
        begun = data.rfind(b"$", end)
        self.held = data[begun:] if begun >= 0 and _BEGUN.match(data, begun) is not None else b""
        self.statistics.stray_bytes += _stray(data[end : len(data) - len(self.held)])
        self.statistics.frames += len(frames)
        return frames


def _stray(between: bytes) -> int:
    return len(between) - between.count(b"\r") - between.count(b"\n")

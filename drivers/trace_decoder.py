"""What the decoders of byte traces have in common."""

from __future__ import annotations

from typing import Protocol

from drivers.byte_trace import Direction


class Wrong(str):
    """A line of a decoded trace that tells of an error: broken bytes, or an answer that refuses."""

    __slots__ = ()


class TraceDecoder(Protocol):
    """Fed with the chunks of one port's trace in order; gives lines of printable text."""

    def feed(self, direction: Direction, data: bytes) -> list[str]:
        """The lines for what is complete now; "out" is from the host, "in" to it. ``Wrong`` for errors."""
        ...

    def rest(self) -> list[str]:
        """What never was completed."""
        ...

"""What the declared faults of a device do to its bytes; what they do to its readings is the emulator's own."""

from __future__ import annotations

import zlib
from collections.abc import Callable

import numpy as np

from drivers.twin.bus import FAILING_SHARE, SLOW_FACTOR
from drivers.twin.faults import Verb
from drivers.twin.machine import Twin

Send = Callable[[bytes, float], None]


class BadLine:
    """Stands between an emulated device and its wire. ``send(data, delay_s)`` is the wire's; ``clock`` the loop's time.

    OFF: hears nothing, says nothing. GARBAGE: obeys, but what it says has bits turned. INTERMITTENT: obeys, half of its
    answers are lost. SLOW: everything takes ten times as long. (STUCK, WRONG and DELAYED are not of the line.)
    """

    def __init__(self, device: str, twin: Twin, clock: Callable[[], float], send: Send, byte_s: float) -> None:
        self._device, self._twin, self._clock, self._send = device, twin, clock, send
        self._byte_s = byte_s
        self._random = np.random.default_rng([twin.seed, zlib.crc32(device.encode()), 0xBAD])

    @property
    def verb(self) -> Verb:
        return self._twin.verb(self._device, self._clock())

    @property
    def hears(self) -> bool:
        """Whether what the host sent reaches the device."""
        return self.verb is not Verb.OFF

    def say(self, data: bytes, delay_s: float = 0.0, heard_bytes: int = 0) -> None:
        """An answer to a request of ``heard_bytes``, ``delay_s`` after the request."""
        verb = self.verb
        if verb is Verb.OFF or (verb is Verb.INTERMITTENT and self._random.random() < FAILING_SHARE):
            return
        if verb is Verb.SLOW:
            delay_s += (SLOW_FACTOR - 1.0) * (delay_s + (len(data) + heard_bytes) * self._byte_s)
        self._send(self._garbled(data) if verb is Verb.GARBAGE else data, delay_s)

    def _garbled(self, data: bytes) -> bytes:
        """Bits turned in about every eighth byte, and in the last but one for certain."""
        noisy = bytearray(data)
        places = {max(0, len(noisy) - 2), *self._random.integers(0, len(noisy), len(noisy) // 8).tolist()}
        for place in sorted(places):
            noisy[place] ^= int(self._random.integers(1, 256))
        return bytes(noisy)

"""The messages of an RTK base station: 1005 tells its place truly, the others have type, header and size of
observations (MSM4) and random bits for them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from drivers.gps.rtcm import frame
from drivers.twin.receiver import EQUATOR_M, FLATTENING

WEEK_MS = 7 * 86_400_000
UNIT_M = 0.0001  # of 1005
OBSERVATIONS = ((1074, 210), (1084, 160))  # message number, bytes: 12 GPS and 9 GLONASS satellites on two frequencies


@dataclass(frozen=True, slots=True)
class BaseStation:
    """WGS 84; ``height_m`` above the ellipsoid."""

    latitude_deg: float
    longitude_deg: float
    height_m: float
    number: int = 1

    def epoch(self, now_s: float) -> list[bytes]:
        """The frames of an epoch."""
        time_ms = round(now_s * 1000.0) % WEEK_MS
        return [self.reference(), *(self._observations(kind, size, time_ms) for kind, size in OBSERVATIONS)]

    def reference(self) -> bytes:
        """Message 1005, stationary reference point (19 bytes)."""
        x, y, z = (round(metres / UNIT_M) for metres in self.earth_centred_m)
        fields = [
            (1005, 12), (self.number, 12), (0, 6), (1, 1), (1, 1), (0, 1), (0, 1), (x, 38), (0, 1), (0, 1), (y, 38),
            (0, 2), (z, 38),
        ]  # fmt: skip
        return frame(_bits(fields, 19))

    @property
    def earth_centred_m(self) -> tuple[float, float, float]:
        latitude, longitude = math.radians(self.latitude_deg), math.radians(self.longitude_deg)
        squared = FLATTENING * (2.0 - FLATTENING)
        normal_m = EQUATOR_M / math.sqrt(1.0 - squared * math.sin(latitude) ** 2)
        across_m = (normal_m + self.height_m) * math.cos(latitude)
        return (
            across_m * math.cos(longitude),
            across_m * math.sin(longitude),
            (normal_m * (1.0 - squared) + self.height_m) * math.sin(latitude),
        )

    def _observations(self, kind: int, size: int, time_ms: int) -> bytes:
        head = _bits([(kind, 12), (self.number, 12), (time_ms % (1 << 30), 30), (1, 1), (0, 1)], 7)
        return frame(head + np.random.default_rng([kind, time_ms]).bytes(size - len(head)))


def _bits(fields: Sequence[tuple[int, int]], size: int) -> bytes:
    """Fields (value, bits) from the highest bit on, two's complement, zero to ``size`` bytes."""
    packed = used = 0
    for value, bits in fields:
        packed = (packed << bits) | (value & ((1 << bits) - 1))
        used += bits
    return (packed << (8 * size - used)).to_bytes(size, "big")

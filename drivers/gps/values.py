"""What a GPS receiver gives."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime
from enum import IntEnum


class FixQuality(IntEnum):
    """Quality of a position, worst first (our order, not the digits of NMEA GGA)."""

    NONE = 0
    SINGLE = 1
    DGPS = 2
    RTK_FLOAT = 3
    RTK_FIXED = 4


@dataclass(frozen=True, slots=True)
class Fix:
    """One epoch of a receiver. WGS 84; ``course_rad`` clockwise from true north; what is unknown is None.

    ``accuracy_m`` is the horizontal one-sigma error that the receiver claims (GST) or that follows from its quality.
    ``heading_rad`` is where the base points, clockwise from true north, of a receiver with two antennas (HDT, THS).
    """

    stamp_s: float
    utc: datetime | None
    quality: FixQuality
    latitude_deg: float | None
    longitude_deg: float | None
    altitude_m: float | None
    accuracy_m: float | None
    satellites: int
    hdop: float | None
    speed_m_s: float | None
    course_rad: float | None
    heading_rad: float | None = None

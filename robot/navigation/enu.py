"""WGS 84 positions to the row frame."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

_SEMI_MAJOR_M = 6378137.0
_FLATTENING = 1.0 / 298.257223563
_ECCENTRICITY2 = _FLATTENING * (2.0 - _FLATTENING)


@dataclass(frozen=True, slots=True)
class Datum:
    """Where the row frame's origin lies, and ``heading_rad``, its x axis clockwise from true north."""

    latitude_deg: float
    longitude_deg: float
    heading_rad: float

    def __post_init__(self) -> None:
        if not (-90.0 <= self.latitude_deg <= 90.0 and -180.0 <= self.longitude_deg <= 180.0):
            raise ValueError(f"datum: expected degrees of latitude and longitude, found {self}")
        if not math.isfinite(self.heading_rad):
            raise ValueError(f"datum: expected a finite heading, found {self.heading_rad}")


def ecef_m(latitude_deg: float, longitude_deg: float, altitude_m: float = 0.0) -> npt.NDArray[np.float64]:
    """Earth-centred, earth-fixed coordinates (3,) of a WGS 84 position (NIMA TR8350.2)."""
    latitude, longitude = math.radians(latitude_deg), math.radians(longitude_deg)
    normal_m = _SEMI_MAJOR_M / math.sqrt(1.0 - _ECCENTRICITY2 * math.sin(latitude) ** 2)
    return np.array(
        [
            (normal_m + altitude_m) * math.cos(latitude) * math.cos(longitude),
            (normal_m + altitude_m) * math.cos(latitude) * math.sin(longitude),
            (normal_m * (1.0 - _ECCENTRICITY2) + altitude_m) * math.sin(latitude),
        ]
    )


def enu_m(latitude_deg: float, longitude_deg: float, datum: Datum) -> tuple[float, float]:
    """East and north of the datum, in its tangent plane."""
    delta = ecef_m(latitude_deg, longitude_deg) - ecef_m(datum.latitude_deg, datum.longitude_deg)
    latitude, longitude = math.radians(datum.latitude_deg), math.radians(datum.longitude_deg)
    east = np.array([-math.sin(longitude), math.cos(longitude), 0.0])
    north = np.array(
        [-math.sin(latitude) * math.cos(longitude), -math.sin(latitude) * math.sin(longitude), math.cos(latitude)]
    )
    return float(east @ delta), float(north @ delta)


def row_xy_m(latitude_deg: float, longitude_deg: float, datum: Datum) -> tuple[float, float]:
    """Along and across the row (x forward, y left) of a WGS 84 position."""
    east_m, north_m = enu_m(latitude_deg, longitude_deg, datum)
    sine, cosine = math.sin(datum.heading_rad), math.cos(datum.heading_rad)
    return east_m * sine + north_m * cosine, north_m * sine - east_m * cosine

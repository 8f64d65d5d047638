"""Sun, sky and lamp by the hour."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from drivers.twin.scene import Weather

Array = npt.NDArray[np.float64]

LATITUDE_RAD = math.radians(45.0)
DECLINATION_RAD = math.radians(15.0)  # about 1 May and 12 August
SOLAR_NOON_H = 13.0  # summer time
GLASS_TRANSMISSION = 0.62
SKYLINE_DEG = 5.0  # below it trees and houses take more and more of the beam
LAMP_REFERENCE_M = 0.6


@dataclass(frozen=True, slots=True, eq=False)
class Light:
    """The light on the plants.

    ``sun_direction`` (3,) points to the sun in the row frame; irradiances in W/m2: the sun's on a plane that faces it,
    the sky's on a plane that faces up, the lamp's at 0.6 m on its axis; colour temperatures in kelvin.
    """

    sun_direction: Array
    sun_w_m2: float
    sky_w_m2: float
    lamp_w_m2: float = 0.0
    sun_colour_k: float = 5500.0
    sky_colour_k: float = 7500.0
    lamp_colour_k: float = 5000.0


def sun_position(hour: float) -> tuple[float, float]:
    """Elevation and azimuth (from north over east) of the sun in radians, by the clock hour (Iqbal 1983, eq. 1.5)."""
    turn = math.radians(15.0 * (hour - SOLAR_NOON_H))
    sin_elevation = math.sin(LATITUDE_RAD) * math.sin(DECLINATION_RAD) + math.cos(LATITUDE_RAD) * math.cos(
        DECLINATION_RAD
    ) * math.cos(turn)
    east = -math.cos(DECLINATION_RAD) * math.sin(turn)
    north = math.cos(LATITUDE_RAD) * math.sin(DECLINATION_RAD) - math.sin(LATITUDE_RAD) * math.cos(
        DECLINATION_RAD
    ) * math.cos(turn)
    return math.asin(sin_elevation), math.atan2(east, north)


def light_at(hour: float, weather: Weather = "clear", *, lamp_on: bool = False, row_azimuth_rad: float = 0.0) -> Light:
    """The light at a clock hour under glass; ``row_azimuth_rad`` is where the row's x points, from north over east.

    Direct beam after Meinel (1976): 1353 * 0.7 ** (airmass ** 0.678). ``ValueError`` outside 0 to 24 h.
    """
    if not 0.0 <= hour <= 24.0:
        raise ValueError(f"hour: expected 0 to 24, found {hour:g}; give the clock hour")
    elevation, azimuth = sun_position(hour)
    height = max(math.sin(elevation), 0.0)
    airmass = 1.0 / (height + 0.15 * (math.degrees(max(elevation, 0.0)) + 3.885) ** -1.253)  # Kasten 1966
    beam = 1353.0 * 0.7 ** (airmass**0.678) if elevation > 0.0 else 0.0
    beam *= min(max(math.degrees(elevation) / SKYLINE_DEG, 0.0), 1.0) ** 2
    diffuse = 110.0 * height**0.7 + 2.0 * math.exp(math.degrees(min(elevation, 0.0)) / 2.5)
    if weather == "overcast":
        diffuse, beam = 0.9 * diffuse + 0.3 * beam * height, 0.0
    bearing = azimuth - row_azimuth_rad
    direction = np.array(
        [math.cos(elevation) * math.cos(bearing), -math.cos(elevation) * math.sin(bearing), math.sin(elevation)]
    )
    return Light(
        sun_direction=direction,
        sun_w_m2=GLASS_TRANSMISSION * beam,
        sky_w_m2=GLASS_TRANSMISSION * diffuse,
        lamp_w_m2=60.0 if lamp_on else 0.0,
        sun_colour_k=5600.0 - 3200.0 * math.exp(-math.degrees(max(elevation, 0.0)) / 8.0),
        sky_colour_k=6500.0 if weather == "overcast" else 8000.0,
    )


def rgb_of_colour_temperature(temperature_k: float) -> Array:
    """Linear sRGB (3,) of a black body with luminance 1 (Kim et al. 2002 locus in xyY); 1667 to 25000 K."""
    t = min(max(temperature_k, 1667.0), 25000.0)
    if t <= 4000.0:
        x = -0.2661239e9 / t**3 - 0.2343589e6 / t**2 + 0.8776956e3 / t + 0.179910
    else:
        x = -3.0258469e9 / t**3 + 2.1070379e6 / t**2 + 0.2226347e3 / t + 0.240390
    if t <= 2222.0:
        y = -1.1063814 * x**3 - 1.34811020 * x**2 + 2.18555832 * x - 0.20219683
    elif t <= 4000.0:
        y = -0.9549476 * x**3 - 1.37418593 * x**2 + 2.09137015 * x - 0.16748867
    else:
        y = 3.0817580 * x**3 - 5.87338670 * x**2 + 3.75112997 * x - 0.37001483
    xyz = np.array([x / y, 1.0, (1.0 - x - y) / y])
    to_rgb = np.array([[3.2406, -1.5372, -0.4986], [-0.9689, 1.8758, 0.0415], [0.0557, -0.2040, 1.0570]])
    return np.asarray(np.maximum(to_rgb @ xyz, 0.0))

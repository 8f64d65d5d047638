"""A GPS receiver: where the base truly is, with the noise of its quality, as latitude and longitude."""

from __future__ import annotations

import math
from datetime import timedelta

import numpy as np

from drivers.gps.values import Fix, FixQuality
from drivers.twin.nominal import Nominal

EQUATOR_M = 6_378_137.0  # WGS 84
FLATTENING = 1.0 / 298.257223563
WHITE_M = {
    FixQuality.SINGLE: 0.8,
    FixQuality.DGPS: 0.25,
    FixQuality.RTK_FLOAT: 0.08,
    FixQuality.RTK_FIXED: 0.008,
}
WANDER_M = {
    FixQuality.SINGLE: 1.8,
    FixQuality.DGPS: 0.55,
    FixQuality.RTK_FLOAT: 0.18,
    FixQuality.RTK_FIXED: 0.005,
}
SATELLITES = {
    FixQuality.NONE: 2,
    FixQuality.SINGLE: 8,
    FixQuality.DGPS: 10,
    FixQuality.RTK_FLOAT: 14,
    FixQuality.RTK_FIXED: 18,
}
WANDER_PERIODS_S = (70.0, 190.0, 610.0)
COURSE_FROM_M_S = 0.05
SPEED_NOISE_M_S = 0.01
COURSE_NOISE_RAD = 0.02
HEADING_NOISE_RAD = 0.004  # of two antennas half a metre apart
OUTPUT_DELAY_S = 0.06  # from the epoch to the end of its sentences


class Receiver:
    """Epochs at a fixed rate; the noise belongs to the epoch, so that it does not matter who listens."""

    def __init__(self, nominal: Nominal, seed: int) -> None:
        self._nominal = nominal
        self._seed = seed
        self.quality = nominal.gps_quality
        phases = np.random.default_rng([seed, 0x6B5]).uniform(0.0, math.tau, (2, len(WANDER_PERIODS_S)))
        self._phases = phases

    def next_epoch_s(self, t_s: float) -> float:
        """The first epoch after ``t_s``."""
        rate = self._nominal.gps_rate_hz
        return (math.floor(t_s * rate + 1e-6) + 1) / rate

    def fix(
        self, epoch_s: float, stamp_s: float, pose: tuple[float, float, float], speed_m_s: float, offset_m: float = 0.0
    ) -> Fix:
        """The fix of an epoch; ``pose`` and ``speed_m_s`` are true, ``offset_m`` an error to the east (multipath)."""
        utc = self._nominal.start_utc + timedelta(seconds=epoch_s)
        if self.quality is FixQuality.NONE:
            return Fix(stamp_s, utc, self.quality, None, None, None, None, SATELLITES[self.quality], None, None, None)
        rng = np.random.default_rng([self._seed, 0xF1C5, max(0, round(epoch_s * self._nominal.gps_rate_hz))])
        white, wander = WHITE_M[self.quality], WANDER_M[self.quality]
        x, y, heading = pose
        bearing = self._nominal.gps_row_heading_rad
        east, north = rng.normal(0.0, white, 2) + wander * self._wander(epoch_s)
        east += x * math.sin(bearing) - y * math.cos(bearing) + offset_m
        north += x * math.cos(bearing) + y * math.sin(bearing)
        latitude, longitude = self._geodetic(float(east), float(north))
        speed = abs(speed_m_s + float(rng.normal(0.0, SPEED_NOISE_M_S)))
        backwards_rad = math.pi if speed_m_s < 0.0 else 0.0
        course = (bearing - heading + backwards_rad + float(rng.normal(0.0, COURSE_NOISE_RAD))) % math.tau
        points = self._nominal.gps_two_antennas and self.quality is FixQuality.RTK_FIXED
        return Fix(
            stamp_s=stamp_s,
            utc=utc,
            quality=self.quality,
            latitude_deg=latitude,
            longitude_deg=longitude,
            altitude_m=self._nominal.gps_altitude_m + 1.5 * float(rng.normal(0.0, white)),
            accuracy_m=math.hypot(white, wander),
            satellites=SATELLITES[self.quality],
            hdop=0.7 if self.quality >= FixQuality.RTK_FLOAT else 1.1,
            speed_m_s=speed,
            course_rad=course if abs(speed_m_s) >= COURSE_FROM_M_S else None,
            heading_rad=(bearing - heading + float(rng.normal(0.0, HEADING_NOISE_RAD))) % math.tau if points else None,
        )

    def _wander(self, t_s: float) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
        """Slow error east and north (2,), rms 1."""
        turns = math.tau * t_s / np.array(WANDER_PERIODS_S) + self._phases
        return np.asarray(np.sqrt(2.0 / len(WANDER_PERIODS_S)) * np.sin(turns).sum(axis=1), dtype=np.float64)

    def _geodetic(self, east_m: float, north_m: float) -> tuple[float, float]:
        """Latitude and longitude in degrees on the tangent plane at the datum (good to 1 mm within 100 m)."""
        latitude = math.radians(self._nominal.gps_latitude_deg)
        squared = FLATTENING * (2.0 - FLATTENING)
        w = 1.0 - squared * math.sin(latitude) ** 2
        meridian_m = EQUATOR_M * (1.0 - squared) / w**1.5
        across_m = EQUATOR_M / math.sqrt(w) * math.cos(latitude)
        return (
            self._nominal.gps_latitude_deg + math.degrees(north_m / meridian_m),
            self._nominal.gps_longitude_deg + math.degrees(east_m / across_m),
        )

"""NMEA 0183 sentences of a fix, as a receiver of centimetres writes them (version 4.11)."""

from __future__ import annotations

import math
from datetime import datetime

from drivers.gps.nmea_sentences import M_S_PER_KM_H, M_S_PER_KNOT, checksum
from drivers.gps.values import Fix, FixQuality

GGA_DIGIT = {
    FixQuality.NONE: 0,
    FixQuality.SINGLE: 1,
    FixQuality.DGPS: 2,
    FixQuality.RTK_FIXED: 4,
    FixQuality.RTK_FLOAT: 5,
}
MODE_LETTER = {
    FixQuality.NONE: "N",
    FixQuality.SINGLE: "A",
    FixQuality.DGPS: "D",
    FixQuality.RTK_FIXED: "R",
    FixQuality.RTK_FLOAT: "F",
}
GPS_NUMBERS = ("02", "05", "07", "09", "13", "15", "18", "20", "26", "29", "30", "31")
GLONASS_NUMBERS = ("65", "66", "72", "73", "74", "81", "82", "88", "89", "95", "96", "70")


def sentence(body: str) -> bytes:
    """``body`` between ``$`` and ``*``, with checksum and line end."""
    return f"${body}*{checksum(body):02X}\r\n".encode("ascii")


def gga(talker: str, fix: Fix, correction_age_s: float | None = None) -> bytes:
    fixed = fix.quality is not FixQuality.NONE
    height = f"{_number(fix.altitude_m, 3)},M,0.000,M" if fixed else ",M,,M"
    corrected = fix.quality >= FixQuality.DGPS and correction_age_s is not None
    correction = f"{correction_age_s:.1f},0001" if corrected else ","
    return sentence(
        f"{talker}GGA,{_time(fix.utc)},{_place(fix)},{GGA_DIGIT[fix.quality]},{fix.satellites:02d},"
        f"{_number(fix.hdop, 2) or '99.99'},{height},{correction}"
    )


def rmc(talker: str, fix: Fix) -> bytes:
    knots = None if fix.speed_m_s is None else fix.speed_m_s / M_S_PER_KNOT
    day = "" if fix.utc is None else f"{fix.utc:%d%m%y}"
    status = "V" if fix.quality is FixQuality.NONE else "A"
    return sentence(
        f"{talker}RMC,{_time(fix.utc)},{status},{_place(fix)},{_number(knots, 3)},{_course(fix.course_rad)},{day},,,"
        f"{MODE_LETTER[fix.quality]},V"
    )


def vtg(talker: str, fix: Fix) -> bytes:
    speed = fix.speed_m_s
    knots, km_h = ("", "") if speed is None else (f"{speed / M_S_PER_KNOT:.3f}", f"{speed / M_S_PER_KM_H:.3f}")
    return sentence(f"{talker}VTG,{_course(fix.course_rad)},T,,M,{knots},N,{km_h},K,{MODE_LETTER[fix.quality]}")


def gsa(talker: str, fix: Fix) -> bytes:
    """Two sentences, GPS (system 1) and GLONASS (system 2)."""
    mode = 1 if fix.quality is FixQuality.NONE else 3
    half = (fix.satellites + 1) // 2
    hdop = _number(fix.hdop, 2) or "99.99"
    pdop = "99.99" if fix.hdop is None else f"{1.7 * fix.hdop:.2f}"
    vdop = "99.99" if fix.hdop is None else f"{math.sqrt(1.7**2 - 1.0) * fix.hdop:.2f}"
    told = b""
    for system, numbers, used in ((1, GPS_NUMBERS, half), (2, GLONASS_NUMBERS, fix.satellites - half)):
        places = ",".join([*numbers[:used], *[""] * 12][:12])
        told += sentence(f"{talker}GSA,A,{mode},{places},{pdop},{hdop},{vdop},{system}")
    return told


def gst(talker: str, fix: Fix) -> bytes:
    sigma = _number(fix.accuracy_m, 3)
    height = "" if fix.accuracy_m is None else f"{1.5 * fix.accuracy_m:.3f}"
    return sentence(f"{talker}GST,{_time(fix.utc)},,,,,{sigma},{sigma},{height}")


def hdt(talker: str, fix: Fix) -> bytes:
    return sentence(f"{talker}HDT,{_course(fix.heading_rad)},T")


def _number(value: float | None, digits: int) -> str:
    return "" if value is None else f"{value:.{digits}f}"


def _course(rad: float | None) -> str:
    return "" if rad is None else f"{math.degrees(rad) % 360.0:.3f}"


def _time(utc: datetime | None) -> str:
    return "" if utc is None else f"{utc:%H%M%S}.{utc.microsecond // 10_000:02d}"


def _place(fix: Fix) -> str:
    """Seven decimals of a minute: 0.2 mm."""
    if fix.latitude_deg is None or fix.longitude_deg is None:
        return ",,,"
    latitude = _degrees(fix.latitude_deg, 2) + ("N" if fix.latitude_deg >= 0.0 else "S")
    return f"{latitude},{_degrees(fix.longitude_deg, 3)}{'E' if fix.longitude_deg >= 0.0 else 'W'}"


def _degrees(angle_deg: float, width: int) -> str:
    whole, minutes = divmod(round(abs(angle_deg) * 60.0 * 1e7), 60 * 10**7)
    return f"{whole:0{width}d}{minutes // 10**7:02d}.{minutes % 10**7:07d},"

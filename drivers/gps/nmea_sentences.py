"""What an NMEA 0183 sentence says: GGA GNS RMC GLL VTG GSA GST HDT THS ZDA of any talker.

Fields are those of NMEA 0183 version 4.11. Every field is doubted: what is empty, malformed or impossible is None.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from datetime import date

import pynmea2

from drivers.gps.values import FixQuality

M_S_PER_KNOT = 1852.0 / 3600.0
M_S_PER_KM_H = 1.0 / 3.6
WORST_DOP = 99.0  # receivers write 99.99 for "unknown"
GGA_QUALITY = {
    0: FixQuality.NONE,
    1: FixQuality.SINGLE,
    2: FixQuality.DGPS,
    3: FixQuality.SINGLE,  # the precise service of GPS
    4: FixQuality.RTK_FIXED,
    5: FixQuality.RTK_FLOAT,
    6: FixQuality.NONE,  # dead reckoning, typed in and simulated positions are not measured by satellite
    7: FixQuality.NONE,
    8: FixQuality.NONE,
}
MODE_LETTERS = {
    "A": FixQuality.SINGLE,
    "P": FixQuality.SINGLE,
    "D": FixQuality.DGPS,
    "F": FixQuality.RTK_FLOAT,
    "R": FixQuality.RTK_FIXED,
    "E": FixQuality.NONE,
    "M": FixQuality.NONE,
    "N": FixQuality.NONE,
    "S": FixQuality.NONE,
}

_NAME = re.compile(r"[Pp][0-9A-Za-z]{3,}|[0-9A-Za-z]{5}")
_NUMBER = re.compile(r"[+-]?(\d+(\.\d*)?|\.\d+)")
_TIME = re.compile(r"(\d\d)(\d\d)(\d\d(\.\d*)?)")
_DATE = re.compile(r"(\d\d)(\d\d)(\d\d)")


class BadSentence(ValueError):
    """A frame that is not a sentence: wrong checksum, or nothing that NMEA knows."""


@dataclass(frozen=True, slots=True)
class Sentence:
    """What one sentence says. ``kind`` is its three letters; ``day_s`` seconds since midnight UTC.

    ``quality`` is None where the sentence does not tell. ``date_given`` tells a malformed date from an absent one.
    Angles are in degrees clockwise from true north, sigmas one-sigma errors; ``mode`` is 1 none, 2 2-D, 3 3-D (GSA).
    """

    talker: str
    kind: str
    day_s: float | None = None
    date: date | None = None
    date_given: bool = False
    quality: FixQuality | None = None
    latitude_deg: float | None = None
    longitude_deg: float | None = None
    altitude_m: float | None = None
    satellites: int | None = None
    hdop: float | None = None
    mode: int | None = None
    speed_m_s: float | None = None
    course_deg: float | None = None
    heading_deg: float | None = None
    north_sigma_m: float | None = None
    east_sigma_m: float | None = None
    correction_age_s: float | None = None


def parse(frame: bytes) -> Sentence:
    """The sentence of a frame ``$...*hh``. Raises ``BadSentence``."""
    text = frame.decode("ascii", "replace")
    kind = text[3:6].upper() if text[6:7] == "," and text[1:2] not in "Pp" else ""
    if kind not in _READERS:
        other = _other(text)
        return _ths(text) if kind == "THS" else other
    try:
        return _READERS[kind](pynmea2.parse(text, check=True))
    except pynmea2.ParseError as error:
        raise BadSentence(f"{error.args[0][0]}: {text}") from None


def checksum(body: str) -> int:
    """The checksum of what stands between ``$`` and ``*``."""
    return int(pynmea2.NMEASentence.checksum(body))


def _other(text: str) -> Sentence:
    """A sentence that nothing is taken from. It counts as heard only with its checksum right."""
    body, _, digits = text[1:].partition("*")
    if checksum(body) != int(digits, 16):
        raise BadSentence(f"checksum does not match: {text}")
    name = body.partition(",")[0]
    if _NAME.fullmatch(name) is None:
        raise BadSentence(f"no sentence of NMEA: {text}")
    return Sentence("P", name[1:]) if name[0] in "Pp" else Sentence(name[:2], name[2:].upper())


def _gga(s: pynmea2.NMEASentence) -> Sentence:
    quality = _integer(_raw(s, "gps_qual"))
    latitude, longitude = _place(s)
    return Sentence(
        s.talker, "GGA", _day_s(_raw(s, "timestamp")),
        quality=None if quality is None else GGA_QUALITY.get(quality, FixQuality.NONE),
        latitude_deg=latitude, longitude_deg=longitude, altitude_m=_number(_raw(s, "altitude")),
        satellites=_integer(_raw(s, "num_sats")), hdop=_dop(_raw(s, "horizontal_dil")),
        correction_age_s=_number(_raw(s, "age_gps_data")),
    )  # fmt: skip


def _gns(s: pynmea2.NMEASentence) -> Sentence:
    letters = _raw(s, "mode_indicator")
    latitude, longitude = _place(s)
    return Sentence(
        s.talker, "GNS", _day_s(_raw(s, "timestamp")),
        quality=max((MODE_LETTERS.get(letter, FixQuality.NONE) for letter in letters), default=None),
        latitude_deg=latitude, longitude_deg=longitude, altitude_m=_number(_raw(s, "altitude")),
        satellites=_integer(_raw(s, "num_sats")), hdop=_dop(_raw(s, "hdop")),
        correction_age_s=_number(_raw(s, "age_gps_data")),
    )  # fmt: skip


def _rmc(s: pynmea2.NMEASentence) -> Sentence:
    latitude, longitude = _place(s)
    speed, written = _number(_raw(s, "spd_over_grnd")), _raw(s, "datestamp")
    return Sentence(
        s.talker, "RMC", _day_s(_raw(s, "timestamp")), date=_date(written), date_given=written != "",
        quality=_status(_raw(s, "status"), _raw(s, "mode_indicator")), latitude_deg=latitude, longitude_deg=longitude,
        speed_m_s=None if speed is None else speed * M_S_PER_KNOT, course_deg=_angle(_raw(s, "true_course")),
    )  # fmt: skip


def _gll(s: pynmea2.NMEASentence) -> Sentence:
    latitude, longitude = _place(s)
    return Sentence(
        s.talker, "GLL", _day_s(_raw(s, "timestamp")), quality=_status(_raw(s, "status"), _raw(s, "faa_mode")),
        latitude_deg=latitude, longitude_deg=longitude,
    )  # fmt: skip


def _vtg(s: pynmea2.NMEASentence) -> Sentence:
    if _raw(s, "faa_mode") in ("N", "E"):
        return Sentence(s.talker, "VTG")
    knots, km_h = _number(_raw(s, "spd_over_grnd_kts")), _number(_raw(s, "spd_over_grnd_kmph"))
    speed = km_h * M_S_PER_KM_H if km_h is not None else None if knots is None else knots * M_S_PER_KNOT
    return Sentence(s.talker, "VTG", speed_m_s=speed, course_deg=_angle(_raw(s, "true_track")))


def _gsa(s: pynmea2.NMEASentence) -> Sentence:
    """One sentence may tell the satellites of one system only; the mode is that of the whole solution."""
    if len(s.data) < 17:  # some receivers without a fix send a stump
        return Sentence(s.talker, "GSA")
    mode = _integer(_raw(s, "mode_fix_type"))
    longer = len(s.data) > 18  # more than twelve satellites: the place of the rest is not known
    return Sentence(
        s.talker, "GSA", mode=mode if mode in (1, 2, 3) else None,
        satellites=None if longer else sum(number != "" for number in s.data[2:14]),
        hdop=None if longer else _dop(_raw(s, "hdop")),
    )  # fmt: skip


def _gst(s: pynmea2.NMEASentence) -> Sentence:
    north, east = _number(_raw(s, "std_dev_latitude")), _number(_raw(s, "std_dev_longitude"))
    return Sentence(s.talker, "GST", _day_s(_raw(s, "timestamp")), north_sigma_m=north, east_sigma_m=east)


def _hdt(s: pynmea2.NMEASentence) -> Sentence:
    return Sentence(s.talker, "HDT", heading_deg=_angle(_raw(s, "heading")))


def _ths(text: str) -> Sentence:
    """``$--THS,heading,mode``: only an autonomous heading (A) is measured."""
    fields = text[: text.index("*")].split(",")
    measured = len(fields) > 2 and fields[2] == "A"
    return Sentence(text[1:3], "THS", heading_deg=_angle(fields[1]) if measured else None)


def _zda(s: pynmea2.NMEASentence) -> Sentence:
    day, month, year = (_integer(_raw(s, name)) for name in ("day", "month", "year"))
    told = None if day is None or month is None or year is None else _real_date(year, month, day)
    return Sentence(
        s.talker, "ZDA", _day_s(_raw(s, "timestamp")), date=told, date_given=bool(day or month or year)
    )  # fmt: skip


_READERS: dict[str, Callable[[pynmea2.NMEASentence], Sentence]] = {
    "GGA": _gga, "GNS": _gns, "RMC": _rmc, "GLL": _gll, "VTG": _vtg, "GSA": _gsa, "GST": _gst, "HDT": _hdt,
    "ZDA": _zda,
}  # fmt: skip


# --- fields


def _raw(s: pynmea2.NMEASentence, name: str) -> str:
    """A field as it was sent; "" when the sentence ends before it."""
    place = type(s).name_to_idx[name]
    return str(s.data[place]) if place < len(s.data) else ""


def _number(text: str) -> float | None:
    return float(text) if len(text) <= 24 and _NUMBER.fullmatch(text) else None


def _integer(text: str) -> int | None:
    return int(text) if len(text) <= 9 and text.isascii() and text.isdigit() else None


def _angle(text: str) -> float | None:
    number = _number(text)
    return number if number is not None and 0.0 <= number <= 360.0 else None


def _dop(text: str) -> float | None:
    number = _number(text)
    return number if number is not None and 0.0 < number < WORST_DOP else None


def _status(status: str, letter: str) -> FixQuality:
    """Of RMC and GLL. The mode letter came with version 2.3; the status of 4.1 is often V and tells nothing."""
    if status not in ("A", "D"):
        return FixQuality.NONE
    if letter == "":
        return FixQuality.DGPS if status == "D" else FixQuality.SINGLE
    return MODE_LETTERS.get(letter, FixQuality.SINGLE)


def _place(s: pynmea2.NMEASentence) -> tuple[float | None, float | None]:
    latitude = _degrees(_raw(s, "lat"), _raw(s, "lat_dir"), "NS", 90.0)
    longitude = _degrees(_raw(s, "lon"), _raw(s, "lon_dir"), "EW", 180.0)
    return (None, None) if latitude is None or longitude is None else (latitude, longitude)


def _degrees(text: str, hemisphere: str, hemispheres: str, largest: float) -> float | None:
    number = _number(text)
    if number is None or number < 0.0 or hemisphere not in tuple(hemispheres):
        return None
    whole, point, rest = text.partition(".")
    minutes = float(whole[-2:] + point + rest)
    degrees = float(whole[:-2] or 0) + minutes / 60.0
    if minutes >= 60.0 or degrees > largest:
        return None
    return degrees if hemisphere == hemispheres[0] else -degrees


def _day_s(text: str) -> float | None:
    """A leap second is 86400 s and more of its day."""
    match = _TIME.fullmatch(text)
    if match is None:
        return None
    hour, minute, second = int(match[1]), int(match[2]), float(match[3])
    if hour > 23 or minute > 59 or second >= 61.0:
        return None
    return 3600.0 * hour + 60.0 * minute + second


def _date(text: str) -> date | None:
    """``ddmmyy``; the satellites have told the time since 1980."""
    match = _DATE.fullmatch(text)
    if match is None:
        return None
    year = int(match[3])
    return _real_date(year + (1900 if year >= 80 else 2000), int(match[2]), int(match[1]))


def _real_date(year: int, month: int, day: int) -> date | None:
    try:
        return date(year, month, day)
    except ValueError:
        return None

"""Sentences of real receivers, and what no sentence may do."""

from __future__ import annotations

import json
import math
import os
from dataclasses import fields
from datetime import date
from pathlib import Path
from typing import Any

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from drivers.gps.decode import NmeaDecoder
from drivers.gps.framing import Framer
from drivers.gps.nmea_sentences import BadSentence, Sentence, checksum, parse
from drivers.gps.values import FixQuality

SHARED = Path(os.environ.get("SPRAYER_SHARED", Path(__file__).parents[4] / "shared"))
VECTORS = SHARED / "data" / "vectors" / "nmea.json"
needs_vectors = pytest.mark.skipif(not VECTORS.exists(), reason=f"no vectors at {VECTORS} (SPRAYER_SHARED)")

REFUSED = {"bad checksum in a real log", "non-NMEA $ line"}
NO_POSITION = {"no fix: pynmea2 lat/lon = 0.0", "RMC void"}
QUALITY = {
    "RTK fixed": FixQuality.RTK_FIXED,
    "RTK float": FixQuality.RTK_FLOAT,
    "DGPS": FixQuality.DGPS,
    "no fix: pynmea2 lat/lon = 0.0": FixQuality.NONE,
    "NMEA 4.1 nav status V with status A: pynmea2 RMC.is_valid False": FixQuality.SINGLE,
    "RMC void": FixQuality.NONE,
}


def vectors(kind: str) -> list[Any]:
    return json.loads(VECTORS.read_text())[kind] if VECTORS.exists() else []


def read(body: str) -> Sentence:
    return parse(f"${body}*{checksum(body):02X}".encode())


def only(text: str) -> bytes:
    (frame,) = (frame for _, frame in Framer().feed(text.encode()))
    return frame


@needs_vectors
@pytest.mark.parametrize("vector", vectors("real"), ids=lambda vector: vector["sentence"][:24])
def test_a_real_sentence_is_read_as_its_note_says(vector: dict[str, str]) -> None:
    text, note = vector["sentence"], vector["note"]
    if note in REFUSED:
        with pytest.raises(BadSentence):
            parse(only(text))
        return
    read = parse(only(text))
    if not text.startswith("$P"):
        assert "$" + read.talker + read.kind == text[:6]
    if note in QUALITY:
        assert read.quality is QUALITY[note]
    if note in QUALITY and note != "no fix: pynmea2 lat/lon = 0.0" and ",V," not in text[:25]:
        assert read.latitude_deg is not None
        assert abs(read.latitude_deg) > 1.0
    if read.kind in ("GGA", "RMC") and ",,,," in text[:40]:
        assert read.latitude_deg is read.longitude_deg is None


@pytest.mark.parametrize("body", ["GNTXT,01,01,02,ANTSTATUS=OK", "PUBX,00,1", "GNTHS,77.5,A", "GNRMC,,V,,,,,,,,,,N"])
def test_no_sentence_of_any_kind_is_taken_with_a_wrong_checksum(body: str) -> None:
    right = checksum(body)
    assert parse(f"${body}*{right:02X}".encode())
    with pytest.raises(BadSentence, match="checksum"):
        parse(f"${body}*{right ^ 1:02X}".encode())


@needs_vectors
def test_the_negative_vectors_say_nothing_false() -> None:
    wrong = {vector["note"].partition(":")[0]: vector["sentence"] for vector in vectors("negative")}
    assert Framer().feed(wrong.pop("truncated, no checksum").encode()) == []
    with pytest.raises(BadSentence, match="6E != 6D"):
        parse(only(wrong.pop("wrong checksum -> ChecksumError (right is 6D)")))
    merged = parse(only(wrong.pop("two sentences merged")))
    assert (merged.kind, merged.date, merged.talker) == ("RMC", date(1994, 11, 19), "GP")
    bad_hemisphere = parse(only(wrong.pop("bad hemisphere")))
    assert bad_hemisphere.latitude_deg is bad_hemisphere.longitude_deg is None
    assert parse(only(wrong.pop("invalid time"))).day_s is None
    estimated = parse(only(wrong.pop("SentenceTypeError (THS unknown to pynmea2 1.19)")))
    assert (estimated.kind, estimated.heading_deg) == ("THS", None)
    assert wrong == {}


def test_every_field_of_gga() -> None:
    gga = read("GNGGA,132819.60,4134.49795459,N,09345.03431408,W,4,10,0.9,278.161,M,-31.442,M,6.6,0133")
    assert gga.latitude_deg == pytest.approx(41.5749659098, abs=1e-10)
    assert gga.longitude_deg == pytest.approx(-93.7505719013, abs=1e-10)
    assert (gga.day_s, gga.quality, gga.satellites) == (48499.6, FixQuality.RTK_FIXED, 10)
    assert (gga.hdop, gga.altitude_m, gga.correction_age_s) == (0.9, 278.161, 6.6)


def test_speed_and_course_of_rmc_and_vtg_agree() -> None:
    rmc = read("GNRMC,132819.60,A,4134.497,N,09345.034,W,10.000,124.888,180320,11.5985,E,D")
    vtg = read("GNVTG,124.888,T,,M,10.000,N,18.520,K,D")
    assert rmc.speed_m_s == pytest.approx(5.1444, abs=1e-4)
    assert vtg.speed_m_s == pytest.approx(5.1444, abs=1e-4)
    assert rmc.course_deg == vtg.course_deg == 124.888
    assert rmc.date == date(2020, 3, 18)


@pytest.mark.parametrize(
    ("digit", "quality"),
    [(0, FixQuality.NONE), (1, FixQuality.SINGLE), (2, FixQuality.DGPS), (3, FixQuality.SINGLE),
     (4, FixQuality.RTK_FIXED), (5, FixQuality.RTK_FLOAT), (6, FixQuality.NONE), (7, FixQuality.NONE),
     (8, FixQuality.NONE), (9, FixQuality.NONE)],
)  # fmt: skip
def test_quality_of_gga(digit: int, quality: FixQuality) -> None:
    assert read(f"GPGGA,120000,4807.038,N,01131.000,E,{digit},08,0.9,545.4,M,46.9,M,,").quality is quality


@pytest.mark.parametrize(
    ("letters", "quality"),
    [("AANN", FixQuality.SINGLE), ("NNNN", FixQuality.NONE), ("RRN", FixQuality.RTK_FIXED), ("F", FixQuality.RTK_FLOAT),
     ("DA", FixQuality.DGPS), ("E", FixQuality.NONE), ("", None)],
)  # fmt: skip
def test_quality_of_gns_is_that_of_its_best_system(letters: str, quality: FixQuality | None) -> None:
    assert read(f"GNGNS,120000.00,4807.038,N,01131.000,E,{letters},13,0.93,545.4,46.9,,").quality is quality


def test_gst_tells_the_errors_to_the_north_and_east() -> None:
    gst = read("GPGST,131519.00,11,,,,0.70,0.49,1.1")
    assert (gst.north_sigma_m, gst.east_sigma_m) == (0.70, 0.49)


def test_headings_of_two_antennas() -> None:
    assert read("GPHDT,25.50,T").heading_deg == 25.5
    assert read("GPHDT,,T").heading_deg is None
    assert read("GNTHS,244.28,A").heading_deg == 244.28
    assert [read(f"GNTHS,244.28,{mode}").heading_deg for mode in "EMSV"] == [None] * 4


@pytest.mark.parametrize(
    "place",
    ["4807.038,X,01131.000,E", "4807.038,,01131.000,E", "9107.038,N,01131.000,E", "4860.000,N,01131.000,E",
     "-807.038,N,01131.000,E", "nan,N,01131.000,E", "4_07.0,N,01131.000,E", "4807.038,N,18131.000,E",
     "4807.038,N,,", "1e3,N,01131.000,E"],
)  # fmt: skip
def test_an_impossible_place_is_none(place: str) -> None:
    gga = read(f"GPGGA,120000,{place},1,08,0.9,545.4,M,46.9,M,,")
    assert gga.latitude_deg is gga.longitude_deg is None


@pytest.mark.parametrize(
    ("text", "day_s"),
    [("000000", 0.0), ("235959.99", 86399.99), ("235960.5", 86400.5), ("240000", None), ("126000", None),
     ("12", None), ("12:00:00", None), ("120000.x", None)],
)  # fmt: skip
def test_times_of_the_day(text: str, day_s: float | None) -> None:
    assert read(f"GPGGA,{text},4807.038,N,01131.000,E,1,08,0.9,545.4,M,46.9,M,,").day_s == day_s


@pytest.mark.parametrize(
    ("text", "told"),
    [("311299", date(1999, 12, 31)), ("010126", date(2026, 1, 1)), ("310226", None), ("2208-1", None), ("", None)],
)
def test_dates(text: str, told: date | None) -> None:
    rmc = read(f"GPRMC,120000,A,4807.038,N,01131.000,E,0.1,,{text},,,A")
    assert rmc.date == told
    assert rmc.date_given == (text != "")


def test_ninety_nine_is_no_dilution() -> None:
    assert read("GPGGA,,,,,,0,00,99.99,,,,,,").hdop is None


printable = st.text(alphabet=st.characters(min_codepoint=0x20, max_codepoint=0x7E, exclude_characters="$*"))
fields_of_any_kind = st.one_of(
    printable.filter(lambda text: "," not in text),
    st.floats().map(str),
    st.integers().map(str),
    st.sampled_from(["", "A", "V", "N", "E", "120000.00", "4807.038", "01131.000", "1e400", "１２"]),
).filter(lambda text: text.isascii())


@given(
    st.sampled_from(["GGA", "GNS", "RMC", "GLL", "VTG", "GSA", "GST", "HDT", "THS", "ZDA", "GSV", "TXT"]),
    st.sampled_from(["GP", "GN", "GL", "GA", "GB", "BD", "QZ", "IN", "II", "P1", "PQ"]),
    st.lists(fields_of_any_kind, max_size=24),
)
@example("RMC", "GP", ["000231.099", "A", "4829.0005", "N", "00022.0015", "E", "0.15", "212.28", "2208-1", "", "", "A"])
def test_no_fields_make_a_sentence_fail_or_tell_what_is_no_number(kind: str, talker: str, parts: list[str]) -> None:
    """P23."""
    body = ",".join([talker + kind, *parts])
    try:
        told = read(body)
    except BadSentence:
        return
    for field in fields(told):
        value = getattr(told, field.name)
        assert not isinstance(value, float) or math.isfinite(value)


@given(printable)
def test_any_body_with_a_checksum_is_read_or_refused(body: str) -> None:
    frame = f"${body}*{checksum(body):02X}".encode()
    decoder = NmeaDecoder()
    assert frame.decode() in "".join(decoder.feed("in", frame) + decoder.rest()) or len(body) < 5 or len(body) > 251

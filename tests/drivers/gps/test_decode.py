"""A receiver's port as a person reads it."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from drivers.gps.decode import NmeaDecoder
from drivers.gps.rtcm import frame

RMC = b"$GNRMC,171926.00,A,4404.14063,N,12118.85478,W,0.117,,180315,,,A*76\r\n"


def test_a_sentence_is_a_line_that_says_what_it_tells() -> None:
    decoder = NmeaDecoder()
    assert decoder.feed("in", RMC[:30]) == []
    (line,) = decoder.feed("in", RMC[30:])
    assert line.startswith("GNRMC day_s=62366 date=2015-03-18 quality=single latitude_deg=44.0690105 ")
    assert line.endswith(RMC.decode().strip())


def test_a_wrong_checksum_and_stray_bytes_are_shown() -> None:
    lines = NmeaDecoder().feed("in", b"\xff\x00" + RMC.replace(b"*76", b"*77") + RMC)
    assert lines[0] == "2 bytes that are no sentence: ff 00"
    assert lines[1].startswith("BAD checksum does not match: 77 != 76")
    assert lines[2].startswith("GNRMC")


def test_corrections_are_told_by_their_number() -> None:
    decoder = NmeaDecoder()
    data = frame(b"\x3e\xd0" + bytes(17))
    assert decoder.feed("out", data[:5]) == []
    assert decoder.feed("out", data[5:] + b"abc") == ["RTCM 1005, 25 bytes", "3 bytes that are no RTCM frame"]


def test_what_never_ended_is_shown_in_the_end() -> None:
    decoder = NmeaDecoder()
    decoder.feed("in", RMC[:20])
    assert decoder.rest() == ["incomplete: $GNRMC,171926.00,A,4"]


@given(st.lists(st.tuples(st.sampled_from(["in", "out"]), st.binary(max_size=200)), max_size=10))
def test_any_bytes_are_shown(chunks) -> None:  # type: ignore[no-untyped-def]
    decoder = NmeaDecoder()
    for direction, data in chunks:
        assert all(line.isprintable() for line in decoder.feed(direction, data))
    decoder.rest()

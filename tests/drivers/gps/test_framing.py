"""Any bytes, split anyhow, into frames."""

from __future__ import annotations

from itertools import pairwise

from hypothesis import given
from hypothesis import strategies as st

from drivers.gps.framing import LONGEST_BYTES, Framer
from drivers.gps.sentence_reader import MOST_AT_ONCE, SentenceReader
from drivers.gps.sentence_text import sentence

RMC = b"$GNRMC,171926.00,A,4404.14063,N,12118.85478,W,0.117,,180315,,,A*76"
GGA = b"$GNGGA,171926.00,4404.14063,N,12118.85478,W,1,12,0.91,1147.2,M,-21.3,M,,*44"

nmea_like = st.one_of(
    st.binary(max_size=60),
    st.sampled_from([RMC, GGA, RMC + b"\r\n", GGA[:30], RMC[20:], b"$", b"*", b"$$", b"*4", b"\r\n", b"$GP*00"]),
    st.text(alphabet="$*,0123456789ABGPRMC\r\n", max_size=40).map(str.encode),
)
streams = st.lists(nmea_like, max_size=12).map(b"".join)


def frames_of(*chunks: bytes) -> list[bytes]:
    framer = Framer()
    return [frame for chunk in chunks for _, frame in framer.feed(chunk)]


def cut(data: bytes, places: list[int]) -> list[bytes]:
    edges = [0, *sorted(place % (len(data) + 1) for place in places), len(data)]
    return [data[a:b] for a, b in pairwise(edges)]


@given(streams, st.lists(st.integers(0, 10_000), max_size=12))
def test_frames_do_not_depend_on_how_the_bytes_are_split(data: bytes, places: list[int]) -> None:
    """P23."""
    whole, split = Framer(), Framer()
    expected = [frame for _, frame in whole.feed(data)]
    assert [frame for chunk in cut(data, places) for _, frame in split.feed(chunk)] == expected
    assert split.held == whole.held
    assert split.statistics == whole.statistics


@given(streams, st.lists(st.integers(0, 10_000), max_size=12))
def test_a_frames_place_is_where_its_dollar_came(data: bytes, places: list[int]) -> None:
    framer, before = Framer(), 0
    for chunk in cut(data, places):
        for place, frame in framer.feed(chunk):
            assert data[before + place : before + place + len(frame)] == frame
        before += len(chunk)


@given(st.binary(max_size=2000), st.binary(max_size=2000))
def test_a_sentence_in_garbage_is_found(before: bytes, after: bytes) -> None:
    """P23."""
    assert RMC in frames_of(before, RMC, after)


@given(st.lists(st.binary(min_size=1, max_size=700), max_size=20))
def test_what_is_held_back_is_bounded(chunks: list[bytes]) -> None:
    framer = Framer()
    for chunk in chunks:
        framer.feed(chunk)
        assert len(framer.held) <= LONGEST_BYTES


def test_a_flood_of_dollars_and_a_sentence_without_end_are_held_within_bounds() -> None:
    for pattern in (b"$" * 4096, b"$" + b"A" * 4095, b"$GPGGA," + b"9" * 200):
        framer = Framer()
        for _ in range(100):
            framer.feed(pattern)
            assert len(framer.held) <= LONGEST_BYTES
        assert [frame for _, frame in framer.feed(RMC)][-1:] == [RMC]


def test_every_byte_is_counted_once() -> None:
    framer = Framer()
    noise = b"\x00\xffnoise$GPG"
    for byte in noise + RMC + b"\r\n" + GGA:
        framer.feed(bytes([byte]))
    statistics = framer.statistics
    assert (statistics.frames, statistics.stray_bytes) == (2, len(noise))
    assert statistics.bytes == len(noise + RMC + GGA) + 2


def test_sentences_without_line_ends_come_apart() -> None:
    assert frames_of(RMC + GGA + RMC) == [RMC, GGA, RMC]


def test_a_sentence_that_another_cuts_short_does_not_take_it_along() -> None:
    assert frames_of(GGA[:31] + RMC) == [RMC]


def test_a_sentence_without_checksum_is_none() -> None:
    assert frames_of(b"$GPGGA,184353.07,1929.0\r\n" + RMC) == [RMC]


@given(st.lists(streams, max_size=10))
def test_no_bytes_make_the_reader_fail(chunks: list[bytes]) -> None:
    reader = SentenceReader(1e-4)
    for number, chunk in enumerate(chunks):
        for began_s, _ in reader.feed(chunk, float(number)):
            assert began_s <= number


def test_more_sentences_than_a_receiver_can_send_are_refused_unread() -> None:
    reader = SentenceReader(1e-5)
    flood = sentence("GNTXT,01,01,02,flood") * 2000
    read = reader.feed(flood, 1.0)
    assert len(read) == MOST_AT_ONCE
    assert reader.statistics.refused == 2000 - MOST_AT_ONCE
    assert len(reader.feed(RMC, 1.5)) == 1


def test_a_sentence_is_stamped_with_its_first_bit() -> None:
    byte_s = 1e-3
    reader = SentenceReader(byte_s)
    assert reader.feed(RMC[:10], 5.0) == []
    assert reader.feed(RMC[10:30], 5.1) == []
    (began_s, _), (next_s, _) = reader.feed(RMC[30:] + b"\r\n" + GGA, 6.0)
    assert began_s == 5.0 - 10 * byte_s
    assert next_s == 6.0 - len(GGA) * byte_s

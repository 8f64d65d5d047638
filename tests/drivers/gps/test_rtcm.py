"""Frames of RTCM 3 in any bytes."""

from __future__ import annotations

import math
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.gps.base_station import BaseStation
from drivers.gps.rtcm import LONGEST_PAYLOAD, RtcmFramer, crc24q, frame, message_number

# message 1005 of RTCM 10403.1, example in section 4: station 2003
EXAMPLE = bytes.fromhex("d300133ed7d30202980edeef34b4bd62ac0941986f33360b98")
EXAMPLE_XYZ_M = (1_114_104.5999, -4_850_729.7108, 3_975_521.4643)

payloads = st.binary(min_size=2, max_size=60)
streams = st.lists(st.one_of(st.binary(max_size=40), payloads.map(frame)), max_size=8).map(b"".join)


def test_the_checksum_of_the_standards_example() -> None:
    assert crc24q(EXAMPLE[:-3]) == 0x360B98
    assert crc24q(EXAMPLE) == 0
    assert frame(EXAMPLE[3:-3]) == EXAMPLE
    assert message_number(EXAMPLE) == 1005


def bits(data: bytes, first: int, count: int) -> int:
    whole = int.from_bytes(data, "big") >> (8 * len(data) - first - count)
    value = whole & ((1 << count) - 1)
    return value - (1 << count) if value >> (count - 1) else value


def place_m(reference: bytes) -> tuple[float, float, float]:
    payload = reference[3:-3]
    return tuple(1e-4 * bits(payload, first, 38) for first in (34, 74, 114))  # type: ignore[return-value]


def test_the_base_tells_its_place_as_the_standard_does() -> None:
    assert place_m(EXAMPLE) == pytest.approx(EXAMPLE_XYZ_M, abs=1e-4)
    base = BaseStation(47.66, 9.175, 452.0, number=7)
    reference = base.reference()
    assert len(reference) == len(EXAMPLE)
    assert bits(reference[3:], 12, 12) == 7
    assert place_m(reference) == pytest.approx(base.earth_centred_m, abs=1e-4)


def test_the_earth_centred_place_is_on_the_ellipsoid_and_rises_along_its_normal() -> None:
    assert BaseStation(0.0, 0.0, 0.0).earth_centred_m == pytest.approx((6_378_137.0, 0.0, 0.0))
    assert BaseStation(90.0, 0.0, 0.0).earth_centred_m == pytest.approx((0.0, 0.0, 6_356_752.3142), abs=1e-3)
    x, y, z = foot = BaseStation(47.66, 9.175, 0.0).earth_centred_m
    assert (x * x + y * y) / 6_378_137.0**2 + z * z / 6_356_752.3142**2 == pytest.approx(1.0, abs=1e-10)
    top = BaseStation(47.66, 9.175, 404.0).earth_centred_m
    latitude, longitude = math.radians(47.66), math.radians(9.175)
    normal = (
        math.cos(latitude) * math.cos(longitude), math.cos(latitude) * math.sin(longitude), math.sin(latitude),
    )  # fmt: skip
    assert [(b - a) / 404.0 for a, b in zip(foot, top, strict=True)] == pytest.approx(normal, abs=1e-9)


def test_an_epoch_of_the_base_is_whole_frames() -> None:
    frames = BaseStation(47.66, 9.175, 452.0).epoch(12.0)
    framer = RtcmFramer()
    assert framer.feed(b"".join(frames)) == frames
    assert [message_number(one) for one in frames] == [1005, 1074, 1084]
    assert framer.statistics.stray_bytes == 0


@given(streams, st.lists(st.integers(0, 10_000), max_size=8))
def test_frames_do_not_depend_on_how_the_bytes_are_split(data: bytes, places: list[int]) -> None:
    whole, split = RtcmFramer(), RtcmFramer()
    edges = [0, *sorted(place % (len(data) + 1) for place in places), len(data)]
    assert [one for a, b in pairwise(edges) for one in split.feed(data[a:b])] == whole.feed(data)
    assert split.statistics == whole.statistics


@given(payloads, st.binary(max_size=1100))
def test_a_frame_in_garbage_is_found_in_the_end(payload: bytes, noise: bytes) -> None:
    framer = RtcmFramer()
    found = framer.feed(noise + frame(payload)) + framer.feed(bytes(LONGEST_PAYLOAD + 6))
    assert frame(payload) in found


@given(st.integers(0, 24), st.integers(1, 255))
def test_a_turned_bit_is_no_frame(place: int, turned: int) -> None:
    broken = bytearray(EXAMPLE)
    broken[place] ^= turned
    framer = RtcmFramer()
    assert framer.feed(bytes(broken) + bytes(LONGEST_PAYLOAD + 6)) == []


def test_a_payload_that_is_too_long_is_refused() -> None:
    with pytest.raises(ValueError, match="at most 1023"):
        frame(bytes(1024))

"""Finding frames in any bytes, and the frames of makers and captures both ways."""

from __future__ import annotations

import asyncio
import json
import os
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.byte_trace import Direction
from drivers.emulation.bad_line import BadLine
from drivers.emulation.modbus_slave import ModbusSlaves
from drivers.modbus_decode import ModbusDecoder
from drivers.modbus_frames import LONGEST_BYTES, FrameFinder, answer_size, request_size, valid, with_crc
from drivers.relay.emulator import emulated_board
from drivers.relay.frames import all_off_frames
from drivers.relay.profiles import PROFILES
from drivers.relay.values import Channel
from tests.drivers.modbus_bus import Memory
from tests.drivers.twin import rig

SHARED = Path(os.environ.get("SPRAYER_SHARED", Path(__file__).parents[3] / "shared"))
VECTORS = SHARED / "data" / "vectors" / "modbus.json"
needs_vectors = pytest.mark.skipif(not VECTORS.is_file(), reason=f"no golden frames at {VECTORS} (SPRAYER_SHARED)")

REQUESTS = st.one_of(
    st.builds(
        lambda unit, function, data: with_crc(bytes([unit, function]) + data),
        st.integers(0, 255), st.integers(1, 6), st.binary(min_size=4, max_size=4),
    ),
    st.builds(
        lambda unit, words: with_crc(bytes([unit, 16, 0, 7, 0, len(words), 2 * len(words)])
                                     + b"".join(word.to_bytes(2, "big") for word in words)),
        st.integers(0, 255), st.lists(st.integers(0, 0xFFFF), min_size=1, max_size=20),
    ),
)  # fmt: skip


def vectors() -> list[dict[str, Any]]:
    return list(json.loads(VECTORS.read_text())["vectors"]) if VECTORS.is_file() else []


def vector(name: str) -> bytes:
    return next(bytes.fromhex(each["hex"]) for each in vectors() if each["name"] == name)


def chunks_of(data: bytes, cuts: list[int]) -> list[bytes]:
    places = sorted({0, len(data), *(cut % (len(data) + 1) for cut in cuts)})
    return [data[a:b] for a, b in pairwise(places)]


CUTS = st.lists(st.integers(0, 1000), max_size=20)


@given(st.binary(max_size=600), CUTS, st.sampled_from([request_size, answer_size]))
def test_any_bytes_cut_anyhow_give_the_same_frames_and_none_is_lost(data: bytes, cuts: list[int], size: Any) -> None:
    whole, cut = FrameFinder(size), FrameFinder(size)
    at_once = whole.feed(data) + whole.silence()
    in_pieces = []
    for piece in chunks_of(data, cuts):
        in_pieces += cut.feed(piece)
        assert cut.held <= LONGEST_BYTES
    in_pieces += cut.silence()
    assert [found.data for found in at_once if found.is_frame] == [found.data for found in in_pieces if found.is_frame]
    assert b"".join(found.data for found in at_once) == data
    assert all(valid(found.data) for found in at_once if found.is_frame)


@given(st.lists(st.tuples(st.binary(max_size=40), REQUESTS), max_size=6), CUTS)
def test_frames_between_garbage_are_found(told: list[tuple[bytes, bytes]], cuts: list[int]) -> None:
    """Garbage that happens to end in a frame of its own may swallow what overlaps it; it hardly ever does."""
    finder = FrameFinder(request_size)
    stream = b"".join(garbage + frame for garbage, frame in told)
    found = [each.data for piece in chunks_of(stream, cuts) for each in finder.feed(piece) if each.is_frame]
    strangers = [frame for frame in found if frame not in [frame for _, frame in told]]
    if not strangers:
        assert found == [frame for _, frame in told]


@settings(max_examples=60, deadline=None)
@given(st.lists(st.binary(max_size=300), max_size=6))
def test_units_hear_any_bytes_without_an_exception(pieces: list[bytes]) -> None:
    async def main() -> None:
        clock = asyncio.get_running_loop().time
        said: list[bytes] = []
        line = BadLine("relay", rig.twin(), clock, lambda data, delay_s: said.append(data), 1e-4)
        slaves = ModbusSlaves(clock, 1e-4)
        slaves.add(1, Memory(), line)
        slaves.add(2, emulated_board("ryn408f", 2, rig.twin(), clock, {}), line)
        for piece in pieces:
            slaves.receive(piece)
        await asyncio.sleep(0.01)
        slaves.receive(with_crc(bytes([1, 3, 0, 0, 0, 1])))
        assert said[-1] == with_crc(bytes([1, 3, 2, 0, 0]))

    asyncio.run(main())


@needs_vectors
@pytest.mark.parametrize("each", vectors(), ids=lambda each: str(each["name"])[:40])
def test_the_checksums_of_known_frames_are_ours(each: dict[str, Any]) -> None:
    assert valid(bytes.fromhex(each["hex"]))
    if each.get("reply", "echo") != "echo":
        assert valid(bytes.fromhex(each["reply"])) == (each["name"] != MISPRINTED)


MISPRINTED = "read ch1-2"  # its reply's checksum is wrong in the source


def board_of(each: dict[str, Any]) -> tuple[str, int] | None:
    source = str(each["source"])
    if "Waveshare" in source:
        return "waveshare-8", 1
    if "R4D8A08" in source:
        return "r4d8a08", 1
    if "LC " in source:
        return "lc-8", 255
    return ("waveshare-8", 1) if each["name"].startswith(("read 8 coils", "write", "DANGER")) else None


@needs_vectors
@pytest.mark.parametrize("each", [v for v in vectors() if board_of(v)], ids=lambda each: str(each["name"])[:40])
def test_the_emulated_board_answers_known_frames_as_the_real_one_does(each: dict[str, Any]) -> None:
    found = board_of(each)
    assert found is not None
    profile, unit_id = found
    frame = bytes.fromhex(each["hex"])

    async def main() -> bytes:
        clock = asyncio.get_running_loop().time
        said: list[bytes] = []
        line = BadLine("relay", rig.twin(), clock, lambda data, delay_s: said.append(data), 1e-4)
        slaves = ModbusSlaves(clock, 1e-4)
        slaves.add(unit_id, emulated_board(profile, unit_id, rig.twin(), clock, {Channel.VALVE: 8}), line)
        slaves.receive(frame)
        return b"".join(said)

    reply = asyncio.run(main())
    expected = frame if each.get("reply", "echo") == "echo" and frame[1] in (5, 6) else None
    if expected is None and frame[1] in (1, 2, 3):  # what is on differs; unit, function and length do not
        known = bytes.fromhex(each["reply"])
        assert (len(reply), reply[:3]) == (len(known), known[:3])
    elif expected is None:
        assert reply == with_crc(frame[:6])
    else:
        assert reply == expected


@needs_vectors
@pytest.mark.parametrize(
    ("profile", "unit_id", "write", "name"),
    [
        ("waveshare-8", 1, lambda p: p.pulse.write.of(1, 7), "waveshare flash-on relay0 700 ms"),
        ("waveshare-8", 1, lambda p: p.pulse.write.of(2, 8), "waveshare flash-on relay1 800 ms"),
        ("waveshare-8", 1, lambda p: p.on.of(1), "relay0 on"),
        ("waveshare-8", 1, lambda p: p.cancel.of(1), "relay0 off"),
        ("lc-8", 255, lambda p: p.on.of(1), "LC id255 relay1 on"),
        ("lc-8", 255, lambda p: p.cancel.of(1), "LC relay1 off"),
        ("r4d8a08", 1, lambda p: p.on.of(1), "R4D8A08 ch1 on"),
        ("r4d8a08", 1, lambda p: p.pulse.write.of(1, 10), "ch1 delay 10 s"),
        ("r4d8a08", 1, lambda p: p.pulse.write.of(1, 100), "ch1 delay 100 s"),
        ("r4d8a08", 1, lambda p: p.clear, "all off"),
    ],
)
def test_the_profiles_write_the_frames_that_the_makers_print(profile: str, unit_id: int, write: Any, name: str) -> None:
    assert with_crc(bytes([unit_id]) + write(PROFILES[profile]).request().payload) == vector(name)


def test_all_off_as_bytes_is_one_frame_for_boards_of_coils() -> None:
    assert all_off_frames(PROFILES["waveshare-8"], 1, (1, 2)) == (bytes.fromhex("01 0f 00 00 00 08 01 00 fe 95"),)


def test_all_off_as_bytes_stops_the_delays_that_all_off_does_not() -> None:
    frames = all_off_frames(PROFILES["r4d8a08"], 1, (2, 1))
    assert [frame[2:6].hex() for frame in frames] == ["00020600", "00010600", "00000800"]
    assert frames[-1] == bytes.fromhex("01 06 00 00 08 00 8e 0a")


@pytest.mark.parametrize("profile", PROFILES)
def test_all_off_as_bytes_opens_every_coil_of_the_board(profile: str) -> None:
    async def main() -> None:
        clock = asyncio.get_running_loop().time
        twin = rig.twin()
        board = emulated_board(profile, 7, twin, clock, {Channel.VALVE: 2, Channel.PUMP: 1})
        slaves = ModbusSlaves(clock, 1e-4)
        slaves.add(7, board, BadLine("relay", twin, clock, lambda data, delay_s: None, 1e-4))
        board.outputs.pulse(1, 100.0)
        board.outputs.pulse(2, 100.0)
        board.outputs.switch(4, True)
        assert board.outputs.contacts()[:4] == [True, True, False, True]
        for frame in all_off_frames(PROFILES[profile], 0, (2, 1)):
            slaves.receive(frame)
        assert not any(board.outputs.contacts())

    asyncio.run(main())


def decoded(chunks: list[tuple[Direction, str]], tcp: bool = False) -> list[str]:
    decoder = ModbusDecoder(tcp)
    return [
        line for direction, text in chunks for line in decoder.feed(direction, bytes.fromhex(text))
    ] + decoder.rest()


def test_the_decoder_tells_each_frame_and_each_error() -> None:
    told = decoded(
        [
            ("out", "01 05 02 00 00 07 8d b0"),
            ("in", "01 05 02 00"),
            ("in", "00 07 8d b0"),
            ("out", "01 01 00 00 00 08 3d cc"),
            ("in", "01 01 01 04 50 4b"),
            ("out", with_crc(bytes.fromhex("01 03 00 64 00 01")).hex()),
            ("in", "01 83 02 c0 f1"),
            ("out", with_crc(bytes.fromhex("02 10 00 03 00 02 04 00 02 00 07")).hex()),
            ("in", "02 10 00 03 ff ff"),
            ("out", with_crc(bytes.fromhex("00 0f 00 00 00 08 01 00")).hex()),
        ]
    )
    assert told == [
        "unit 1 write coil 0x0200 = 0x0007",
        "unit 1 write coil 0x0200 = 0x0007",
        "unit 1 read coils 0x0000 count 8",
        "unit 1 read coils = 00100000",
        "unit 1 read holding 0x0064 count 1",
        "unit 1 read holding: exception 2 (illegal data address)",
        "unit 2 write registers 0x0003 count 2 = 0x0002 0x0007",
        "CRC error in an answer: 02 10 00 03 ff ff",
        "all units write coils 0x0000 count 8 = 00000000",
    ]


def test_the_decoder_reads_modbus_tcp() -> None:
    told = decoded(
        [
            ("out", "00 01 00 00 00 06 01 06 00 01 06 00"),
            ("in", "00 01 00 00 00 06 01 06 00 01"),
            ("in", "06 00 00 02 00"),
        ],
        tcp=True,
    )
    assert told == [
        "#1 unit 1 write register 0x0001 = 0x0600",
        "#1 unit 1 write register 0x0001 = 0x0600",
        "incomplete: 00 02 00",
    ]


@given(st.lists(st.tuples(st.sampled_from(["in", "out"]), st.binary(max_size=300)), max_size=10), st.booleans())
def test_the_decoder_takes_any_bytes(chunks: list[tuple[Any, bytes]], tcp: bool) -> None:
    decoder = ModbusDecoder(tcp)
    for direction, data in chunks:
        assert all("\n" not in line for line in decoder.feed(direction, data))
    decoder.rest()
    assert decoder.rest() == []

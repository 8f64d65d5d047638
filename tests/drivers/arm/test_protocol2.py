"""Packets: golden vectors both ways, and what a stream of bytes may hold."""

from __future__ import annotations

import json
import os
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.arm.protocol2 import BROADCAST, Broken, Instruction, Noise, Packet, PacketReader, packet
from drivers.arm.sdk_port import PacketHandler

SHARED = Path(os.environ.get("SPRAYER_SHARED", Path(__file__).parents[4] / "shared"))
VECTORS = SHARED / "data" / "vectors" / "dynamixel_p2.json"
needs_vectors = pytest.mark.skipif(not VECTORS.exists(), reason=f"no vectors at {VECTORS} (SPRAYER_SHARED)")


@cache
def vectors(kind: str) -> dict[str, bytes]:
    if not VECTORS.exists():
        return {}
    told = json.loads(VECTORS.read_text())["vectors"]
    return {vector["name"]: bytes.fromhex(vector["hex"]) for vector in told if vector["kind"] == kind}


def every(kind: str) -> pytest.MarkDecorator:
    return pytest.mark.parametrize("name", list(vectors(kind)) or ["none"])


class Wire:
    """A port handler that keeps what is written and gives what it is told, as the SDK sees one."""

    def __init__(self, answer: bytes = b"") -> None:
        self.is_using = False
        self.written = b""
        self._answer = answer

    def clearPort(self) -> None:
        pass

    def writePort(self, data: list[int]) -> int:
        self.written += bytes(data)
        return len(data)

    def readPort(self, length: int) -> bytes:
        data, self._answer = self._answer[: max(0, length)], self._answer[max(0, length) :]
        return data

    def setPacketTimeout(self, length: int) -> None:
        pass

    def isPacketTimeout(self) -> bool:
        return True


def as_sdk_packet(servo_id: int, instruction: int, data: bytes) -> list[int]:
    """As the SDK's methods build it: without stuffing, room for header and CRC."""
    length = len(data) + 3
    return [0, 0, 0, 0, servo_id, length & 255, length >> 8, instruction, *data, 0, 0]


@needs_vectors
@every("instruction")
def test_an_instruction_is_sent_as_the_vector_says(name: str) -> None:
    raw = vectors("instruction")[name]
    (found,) = PacketReader().feed(raw)
    assert isinstance(found, Packet)
    assert packet(found.servo_id, found.instruction, found.data) == raw
    wire = Wire()
    PacketHandler().txPacket(wire, as_sdk_packet(found.servo_id, found.instruction, found.data))  # type: ignore[arg-type]
    assert wire.written == raw


@needs_vectors
@every("status")
def test_a_status_is_read_as_the_vector_says(name: str) -> None:
    raw = vectors("status")[name]
    (found,) = PacketReader().feed(raw)
    assert isinstance(found, Packet)
    assert found.instruction == Instruction.STATUS
    if found.servo_id != BROADCAST:
        assert packet(found.servo_id, found.instruction, found.data) == raw
    read, result = PacketHandler().rxPacket(Wire(raw), found.servo_id == BROADCAST)
    assert result == 0
    assert bytes(read[8 : 8 + len(found.data)]) == found.data


@needs_vectors
@every("negative")
def test_a_packet_that_was_not_stuffed_is_rejected(name: str) -> None:
    (found,) = PacketReader().feed(vectors("negative")[name])
    assert isinstance(found, Broken)


def test_the_sdks_methods_send_stuffed_packets() -> None:
    wire = Wire()
    PacketHandler().write4ByteTxOnly(wire, 1, 116, -131_073 & 0xFFFFFFFF)
    assert wire.written.hex(" ") == "ff ff fd 00 01 0a 00 03 74 00 ff ff fd fd ff 23 e5"


def test_stuffing_that_arises_across_two_servos_data_is_done() -> None:
    wire = Wire()
    parameters = [0xFD, 0, 0, 0xFF, 0xFF, 0xFD, 1, 2, 3, 4]
    PacketHandler().syncWriteTxOnly(wire, 116, 4, parameters, len(parameters))
    (found,) = PacketReader().feed(wire.written)
    assert isinstance(found, Packet)
    assert list(found.data[4:]) == parameters


packets = st.builds(
    packet,
    st.integers(0, 253),
    st.sampled_from([int(instruction) for instruction in Instruction]),
    st.lists(st.sampled_from([0xFF, 0xFD, 0x00, 0x01, 0x55, 0xFE]), min_size=1, max_size=30).map(bytes),
)
garbage = st.lists(st.sampled_from([0xFF, 0xFD, 0x00, 0xFE, 0x55, 0x03, 0x80]), max_size=40).map(bytes)


def cut(data: bytes, places: list[int]) -> list[bytes]:
    edges = [0, *sorted(place % (len(data) + 1) for place in places), len(data)]
    return [data[a:b] for a, b in pairwise(edges)]


@given(data=st.binary(max_size=400) | garbage, places=st.lists(st.integers(0, 400), max_size=20))
@settings(max_examples=300, deadline=None)
def test_chunked_is_whole_and_every_byte_is_accounted_for(data: bytes, places: list[int]) -> None:
    whole, chunked = PacketReader(), PacketReader()
    found = whole.feed(data)
    pieces = [item for piece in cut(data, places) for item in chunked.feed(piece)]
    assert [item for item in pieces if isinstance(item, Packet)] == [i for i in found if isinstance(i, Packet)]
    assert noise_of(pieces) == noise_of(found)
    assert whole.held_bytes == chunked.held_bytes <= 1100


def noise_of(items: list[Any]) -> bytes:
    return b"".join(item.data for item in items if isinstance(item, Noise))


@given(before=garbage, wanted=st.lists(packets, min_size=1, max_size=5), between=garbage)
@settings(max_examples=300, deadline=None)
def test_packets_in_garbage_are_recovered(before: bytes, wanted: list[bytes], between: bytes) -> None:
    """A header look-alike in the garbage may swallow what follows until its length is over, no more."""
    flush = b"\0" * 1100
    data = before + flush + between.join(wanted) + between
    found = {
        packet(item.servo_id, item.instruction, item.data)
        for item in PacketReader().feed(data + flush)
        if isinstance(item, Packet)
    }
    assert set(wanted) <= found


@given(data=st.binary(max_size=200) | garbage)
@settings(max_examples=300, deadline=None)
def test_whatever_comes_the_sdks_receive_ends_without_an_exception(data: bytes) -> None:
    handler = PacketHandler()
    for fast in (False, True):
        _, result = handler.rxPacket(Wire(data), fast)
        assert isinstance(result, int)


@given(item=packets)
@settings(max_examples=200, deadline=None)
def test_a_packet_comes_back_as_it_was(item: bytes) -> None:
    (found,) = PacketReader().feed(item)
    assert isinstance(found, Packet)
    assert packet(found.servo_id, found.instruction, found.data) == item

"""What a trace of the arm's port says."""

from __future__ import annotations

from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.arm.decode import DynamixelDecoder
from drivers.arm.protocol2 import BROADCAST, HEADER, Instruction, StatusError, crc16, packet, status


def word(*values: int) -> bytes:
    return b"".join(value.to_bytes(2, "little") for value in values)


def test_a_ping_and_its_answer() -> None:
    decoder = DynamixelDecoder()
    assert decoder.feed("out", packet(3, Instruction.PING)) == ["servo 3 ping"]
    assert decoder.feed("in", status(3, 0, word(1120) + b"\x2e")) == ["servo 3 XM540-W270, firmware 46"]


def test_a_write_names_its_registers_and_the_refusal_its_reason() -> None:
    decoder = DynamixelDecoder()
    data = word(112) + (30).to_bytes(4, "little") + (-131_073 & 0xFFFFFFFF).to_bytes(4, "little")
    assert decoder.feed("out", packet(1, Instruction.WRITE, data)) == [
        "servo 1 write profile_velocity=30 goal_position=-131073"
    ]
    assert decoder.feed("in", status(1, StatusError.DATA_RANGE)) == ["servo 1 ERROR value out of range"]
    assert decoder.feed("in", status(1, 0x80)) == ["servo 1 HARDWARE ALERT"]
    assert decoder.feed("in", status(1, 0)) == ["servo 1 ok"]


def test_a_sync_read_and_the_answers_by_name() -> None:
    decoder = DynamixelDecoder()
    asked = packet(BROADCAST, Instruction.SYNC_READ, word(128, 8) + bytes([1, 2]))
    assert decoder.feed("out", asked) == ["all sync read present_velocity, present_position of 1, 2"]
    data = (-3 & 0xFFFFFFFF).to_bytes(4, "little") + (2048).to_bytes(4, "little")
    assert decoder.feed("in", status(1, 0, data) + status(2, 0, data)) == [
        "servo 1 present_velocity=-3 present_position=2048",
        "servo 2 present_velocity=-3 present_position=2048",
    ]


def test_a_fast_sync_read_is_one_line() -> None:
    decoder = DynamixelDecoder()
    decoder.feed("out", packet(BROADCAST, Instruction.FAST_SYNC_READ, word(70, 1) + bytes([1, 2])))
    raw = HEADER + bytes([BROADCAST]) + word(11) + bytes([Instruction.STATUS])
    raw += bytes([0, 1, 0])
    raw += crc16(raw).to_bytes(2, "little")
    raw += bytes([0x80, 2, 0x20])
    raw += crc16(raw).to_bytes(2, "little")
    assert decoder.feed("in", raw) == [
        "servos 1: hardware_error_status=none; 2: HARDWARE ALERT hardware_error_status=0x20 (overload)"
    ]


def test_a_sync_write_gives_each_servos_values() -> None:
    data = word(64, 1) + bytes([1, 1, 2, 0])
    assert DynamixelDecoder().feed("out", packet(BROADCAST, Instruction.SYNC_WRITE, data)) == [
        "all sync write 1: torque_enable=1; 2: torque_enable=0"
    ]


def test_noise_and_broken_packets_are_told() -> None:
    broken = bytearray(packet(1, Instruction.REBOOT))
    broken[-1] ^= 1
    assert DynamixelDecoder().feed("out", b"AT\r" + bytes(broken)) == [
        "noise 41 54 0d",
        "BROKEN servo 1 reboot: the checksum is wrong",
    ]


@given(chunks=st.lists(st.tuples(st.sampled_from(["in", "out"]), st.binary(max_size=60)), max_size=10))
@settings(max_examples=200, deadline=None)
def test_no_bytes_upset_the_decoder(chunks: list[tuple[str, bytes]]) -> None:
    decoder = DynamixelDecoder()
    for direction, data in chunks:
        assert all(isinstance(line, str) for line in decoder.feed(direction, data))  # type: ignore[arg-type]


@given(kind=st.sampled_from([int(i) for i in Instruction]), data=st.binary(max_size=40), answer=st.binary(max_size=40))
@settings(max_examples=200, deadline=None)
def test_no_packet_upsets_the_decoder(kind: int, data: bytes, answer: bytes) -> None:
    decoder = DynamixelDecoder()
    assert len(decoder.feed("out", packet(BROADCAST, kind, data))) == 1
    assert len(decoder.feed("in", packet(1, Instruction.STATUS, answer))) == 1
    assert len(decoder.feed("in", packet(BROADCAST, Instruction.STATUS, answer))) == 1

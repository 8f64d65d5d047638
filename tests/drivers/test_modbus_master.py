"""The Modbus master against units behind a wire, by what arrives at them."""

from __future__ import annotations

import asyncio
import time

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.errors import DeviceFault, DeviceLost, DeviceTimeout
from drivers.modbus_frames import with_crc
from drivers.modbus_master import ModbusLine, ModbusRefusal, ModbusUnit
from tests.drivers.modbus_bus import Bus, Memory, on_a_bus


def unit(line: ModbusLine, unit_id: int = 1) -> ModbusUnit:
    return line.unit("tank", unit_id)


def test_every_function_reaches_the_unit_and_comes_back() -> None:
    memory = Memory()

    async def test(bus: Bus) -> None:
        def job(line: ModbusLine) -> None:
            u = unit(line)
            u.write_register(3, 0xBEEF)
            u.write_registers(4, [1, 0xFFFF])
            assert u.read_holding(3, 3) == u.read_input_registers(3, 3) == [0xBEEF, 1, 0xFFFF]
            u.write_coils(1, [True, False, True] * 3)
            assert u.read_coils(0, 11) == u.read_discrete_inputs(0, 11) == [False] + [True, False, True] * 3 + [False]
            u.write_coil(2, 7)

        await bus.master.run(job)

    on_a_bus(test, (1, memory))
    assert memory.raw_coils == [(2, 7)]


def test_the_frame_on_the_wire_is_the_boards_own() -> None:
    memory = Memory()
    memory.coils = [False] * 0x300

    async def test(bus: Bus) -> None:
        await bus.master.run(lambda line: unit(line).write_coil(0x0200, 7))
        assert bus.sent == bytes.fromhex("01 05 02 00 00 07 8d b0")

    on_a_bus(test, (1, memory))


def test_an_exception_reply_is_a_fault_by_its_name() -> None:
    async def test(bus: Bus) -> None:
        with pytest.raises(ModbusRefusal, match=r"tank: .*function 03.*exception 2 .illegal data address") as told:
            await bus.master.run(lambda line: unit(line).read_holding(100, 1))
        assert told.value.code == 2

    on_a_bus(test, (1, Memory()))


def test_silence_is_a_timeout_and_the_next_request_is_answered() -> None:
    memory = Memory()

    async def test(bus: Bus) -> None:
        with pytest.raises(DeviceTimeout, match=r"unit 9 within 0\.1 s"):
            await bus.master.run(lambda line: unit(line, 9).read_holding(0, 1))
        assert await bus.master.run(lambda line: unit(line).read_holding(0, 1)) == [0]

    on_a_bus(test, (1, memory))


def test_garbage_is_a_fault_that_says_so() -> None:
    async def test(bus: Bus) -> None:
        with pytest.raises(DeviceFault, match="a garbled answer"):
            await bus.master.run(lambda line: unit(line).read_holding(0, 1))
        assert bus.master.statistics.garbled == 1

    on_a_bus(test, (1, Memory()), faults=("relay:garbage",))


class Scripted:
    """Answers with given bytes, whatever it is asked."""

    def __init__(self, bus: Bus, *answers: bytes, delay_s: float = 0.002) -> None:
        self._answers = list(answers)
        self._bus, self._delay_s = bus, delay_s

    def answer(self, function: int, data: bytes) -> bytes | None:
        if self._answers:
            self._bus.wire.send(self._answers.pop(0), self._delay_s)
        return None


@pytest.mark.parametrize(
    ("answer", "why"),
    [
        (with_crc(bytes([2, 6, 0, 1, 0, 5])), "of unit 2"),
        (with_crc(bytes([1, 5, 0, 1, 0, 5])), "of function 5"),
        (with_crc(bytes([1, 6, 0, 2, 0, 5])), "with another echo"),
        (with_crc(bytes([1, 6, 0, 1, 0, 4])), "with another echo"),
        (with_crc(bytes([1, 6, 0, 1, 0, 5]))[:-1], "wrong checksum or length"),
        (with_crc(bytes([1, 6, 0, 1, 0, 5])) + b"\0", "more bytes"),
        (with_crc(bytes([1, 0x85, 2])), "of function 133"),
        (b"\x01\x06", "too short"),
        (b"$GPGGA,,,,,,0,,,,,,,,*66\r\n", "wrong checksum"),
    ],
)
def test_an_answer_that_is_not_quite_right_is_garbled(answer: bytes, why: str) -> None:
    async def test(bus: Bus) -> None:
        bus.slaves.add(1, Scripted(bus, answer), bus.line)
        with pytest.raises(DeviceFault, match=f"a garbled answer \\({why}"):
            await bus.master.run(lambda line: unit(line).write_register(1, 5))

    on_a_bus(test)


def test_a_late_answer_is_not_taken_for_the_next_one() -> None:
    late, fresh = (with_crc(bytes([1, 3, 2, 0, value])) for value in (7, 8))

    async def test(bus: Bus) -> None:
        bus.slaves.add(1, Scripted(bus, late, delay_s=0.3), bus.line)

        def job(line: ModbusLine) -> list[int]:
            with pytest.raises(DeviceTimeout):
                line.unit("tank", 1, 0.25).read_holding(0, 1)
            bus.slaves.add(1, Scripted(bus, fresh, delay_s=0.15), bus.line)
            return line.unit("tank", 1, 0.25).read_holding(0, 1)

        assert await bus.master.run(job) == [8]

    on_a_bus(test)


def test_stray_bytes_before_a_request_are_thrown_away() -> None:
    async def test(bus: Bus) -> None:
        bus.wire.send(b"\x01\x03\x02\x00\x09")
        await asyncio.sleep(0.01)
        assert await bus.master.run(lambda line: unit(line).read_holding(0, 1)) == [0]

    on_a_bus(test, (1, Memory()))


def test_a_talker_that_is_never_silent_does_not_hold_the_bus_up() -> None:
    async def test(bus: Bus) -> None:
        talking = asyncio.ensure_future(_talk(bus))
        start_s = time.monotonic()
        with pytest.raises(DeviceFault, match="garbled"):
            await bus.master.run(lambda line: unit(line).read_holding(0, 1))
        assert time.monotonic() - start_s < 2.0
        talking.cancel()

    on_a_bus(test)


async def _talk(bus: Bus) -> None:
    while True:
        bus.wire.send(b"$GPRMC,,V,,,,,,,,,,N*53\r\n")
        await asyncio.sleep(0.001)


def test_frames_are_parted_by_silence() -> None:
    class Stamped(Memory):
        def answer(self, function: int, data: bytes) -> bytes | None:
            stamps.append(asyncio.get_running_loop().time())
            return super().answer(function, data)

    stamps: list[float] = []

    async def test(bus: Bus) -> None:
        def two(line: ModbusLine) -> None:
            unit(line).read_holding(0, 1)
            unit(line).read_holding(0, 1)

        await bus.master.run(two)

    on_a_bus(test, (1, Stamped()))
    request_s = answer_s = 8 * 10 / 115200
    assert stamps[1] - stamps[0] > request_s + answer_s + 0.00175


def test_two_units_share_the_bus() -> None:
    one, two = Memory(), Memory()
    one.words[0], two.words[0] = 11, 22

    async def test(bus: Bus) -> None:
        reads = [bus.master.run(lambda line, n=n: unit(line, n).read_holding(0, 1)) for n in (1, 2, 1)]  # type: ignore[misc]
        assert await asyncio.gather(*reads) == [[11], [22], [11]]

    on_a_bus(test, (1, one), (2, two))


def test_a_lost_port_is_lost() -> None:
    async def test(bus: Bus) -> None:
        bus.wire.unplug()
        with pytest.raises(DeviceLost):
            await bus.master.run(lambda line: unit(line).read_holding(0, 1))

    on_a_bus(test, (1, Memory()))


def test_a_unit_id_that_cannot_be_is_refused() -> None:
    async def test(bus: Bus) -> None:
        for number in (0, 256):
            with pytest.raises(ValueError, match="unit id of 1 to 255"):
                await bus.master.run(lambda line, number=number: unit(line, number))  # type: ignore[misc]

    on_a_bus(test, (1, Memory()))


VALID = with_crc(bytes([1, 3, 4, 0xBE, 0xEF, 0, 7]))
ANSWERS = st.one_of(
    st.binary(max_size=40),
    st.builds(lambda place, bit: flipped(VALID, place, bit), st.integers(0, 100), st.integers(0, 7)),
    st.builds(lambda end: VALID[:end], st.integers(0, len(VALID))),
    st.builds(lambda before, after: before + VALID + after, st.binary(max_size=3), st.binary(max_size=3)),
)


def flipped(frame: bytes, place: int, bit: int) -> bytes:
    changed = bytearray(frame)
    changed[place % len(frame)] ^= 1 << bit
    return bytes(changed)


@settings(max_examples=30, deadline=None)
@given(ANSWERS)
def test_only_the_whole_answer_and_nothing_else_is_believed(answer: bytes) -> None:
    async def test(bus: Bus) -> None:
        bus.slaves.add(1, Scripted(bus, answer), bus.line)

        def job(line: ModbusLine) -> list[int]:
            return line.unit("tank", 1, 0.05).read_holding(0, 2)

        if answer == VALID:
            assert await bus.master.run(job) == [0xBEEF, 7]
        else:
            # on a busy computer an answer may come too late to be looked at
            with pytest.raises(DeviceTimeout if not answer else (DeviceFault, DeviceTimeout)):
                await bus.master.run(job)

    on_a_bus(test)

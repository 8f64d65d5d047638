"""Bytes at another rate are other bytes, as a real receiver would sample them."""

from __future__ import annotations

import asyncio
import os
from collections.abc import Callable

import pytest
import serial
from hypothesis import given
from hypothesis import strategies as st

from drivers.emulation.uart import misheard
from drivers.emulation.wire import PtyWire

RATES = st.sampled_from([1200, 9600, 19_200, 57_600, 115_200, 1_000_000, 4_000_000])


@given(st.binary(max_size=60), RATES, st.floats(-0.02, 0.02))
def test_rates_that_are_alike_understand_each_other(data: bytes, baud: int, off: float) -> None:
    assert misheard(data, round(baud * (1.0 + off)), baud) == data


@given(st.binary(min_size=1, max_size=60), RATES, RATES)
def test_at_another_rate_other_bytes_are_heard_and_no_more_than_there_is_time_for(
    data: bytes, sent: int, heard: int
) -> None:
    got = misheard(data, sent, heard)
    assert (got == data) == (sent == heard) or data.count(0) + data.count(255) > 0
    assert len(got) <= 1 + len(data) * heard / sent * 10.0 / 9.5


def test_a_receiver_of_twice_the_rate_sees_each_bit_twice() -> None:
    # 55 is 0 1010 1010 1 on the line. First frame: 0 0 11 00 11 0, and 0 where its stop bit should be: broken.
    # Then from the next falling edge on: 0 0 11 00 11 1 (the line is quiet), and a stop bit.
    assert misheard(b"\x55", 9600, 19_200) == bytes([0, 0b11100110])


def test_a_byte_of_zeros_is_a_broken_frame_to_a_faster_receiver() -> None:
    assert misheard(b"\x00", 9600, 115_200) == b"\x00"


async def until(condition: Callable[[], bool]) -> None:
    async with asyncio.timeout(5.0):
        while not condition():  # noqa: ASYNC110 - the wire tells by a plain call
            await asyncio.sleep(0.01)


def test_a_host_that_set_another_rate_is_misheard_and_mishears() -> None:
    async def main() -> None:
        heard: list[bytes] = []
        wire = PtyWire(115_200, heard.append, strict_baud=True)
        wire.plug()
        loop = asyncio.get_running_loop()
        host = serial.Serial(wire.path, 9600, timeout=2.0)
        host.write(b"hello")
        wire.send(b"world")
        assert await loop.run_in_executor(None, host.read, 1) != b"w"
        host.reset_input_buffer()
        host.baudrate = 115_200
        host.write(b"again")
        await until(lambda: b"again" in b"".join(heard))
        assert b"hello" not in b"".join(heard)
        wire.send(b"world")
        assert await loop.run_in_executor(None, host.read, 5) == b"world"
        host.close()
        wire.unplug()

    asyncio.run(main())


@pytest.mark.parametrize("baud", [9600, 1_000_000, 31_250])
def test_a_host_that_sets_no_rate_has_the_devices(baud: int) -> None:
    async def main() -> None:
        heard: list[bytes] = []
        wire = PtyWire(baud, heard.append, strict_baud=True)
        wire.plug()
        host = os.open(wire.path, os.O_RDWR | os.O_NOCTTY)
        os.write(host, b"hello")
        await until(lambda: bool(heard))
        assert heard == [b"hello"]
        os.close(host)
        wire.unplug()

    asyncio.run(main())


def test_a_wire_that_is_not_strict_passes_any_rate() -> None:
    async def main() -> None:
        heard: list[bytes] = []
        wire = PtyWire(115_200, heard.append)
        wire.plug()
        host = serial.Serial(wire.path, 9600, timeout=2.0)
        host.write(b"AT\r")
        await until(lambda: bool(heard))
        assert heard == [b"AT\r"]
        host.close()
        wire.unplug()

    asyncio.run(main())

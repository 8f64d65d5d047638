"""What is at the other end of the port, named within three seconds; nothing is written to it."""

from __future__ import annotations

import asyncio
import os
import termios
import time
from collections.abc import Awaitable, Callable
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.emulation.wire import PtyWire
from drivers.errors import DeviceBusy, DeviceError, DeviceFault, DeviceLost, DeviceMissing, DeviceTimeout, WrongDevice
from drivers.gps.looks import looks_like
from drivers.gps.nmea import NmeaGps, NmeaSettings
from drivers.gps.sentence_text import sentence
from drivers.gps.values import FixQuality
from drivers.line import PortSettings
from tests.drivers.gps.rig import lost

BAUD = 115_200
OPENS_WITHIN_S = 3.0
SLACK_S = 1.5  # of a machine that may be busy
PLACE = "4739.6000000,N,00910.5000000,E"


def burst(second: int) -> bytes:
    time_text = f"10{second // 60 % 60:02d}{second % 60:02d}.00"
    return sentence(f"GNRMC,{time_text},A,{PLACE},0.001,,150626,,,R,V") + sentence(
        f"GNGGA,{time_text},{PLACE},4,18,0.7,404.0,M,48.0,M,1.0,0001"
    )


class StrictWire(PtyWire):
    """Garbles what is heard at another baud rate than its own."""

    def _write(self, data: bytes, plugging: int) -> None:
        if self.plugged and not self._same_baud():
            data = bytes((7 * byte + 91) & 0xFF for byte in data)
        super()._write(data, plugging)

    def _same_baud(self) -> bool:
        slave = os.open(self.path, os.O_RDWR | os.O_NOCTTY)
        try:
            return bool(termios.tcgetattr(slave)[4] == getattr(termios, f"B{self.baud}"))
        finally:
            os.close(slave)


class Talker:
    """Says something every so often."""

    def __init__(self, link: Path, says: Callable[[int], bytes], every_s: float = 0.1, baud: int = BAUD) -> None:
        self.says, self.every_s = says, every_s
        self.heard = b""
        self.wire = StrictWire(baud, self._receive, link)
        self.wire.plug()

    def _receive(self, data: bytes) -> None:
        self.heard += data

    async def serve(self) -> None:
        number = 0
        while True:
            data = self.says(number)
            if self.wire.plugged and data:
                for place in range(0, len(data), 32):
                    self.wire.send(data[place : place + 32])
            number += 1
            await asyncio.sleep(self.every_s)


def device_at(link: Path, baud: int = BAUD) -> NmeaGps:
    return NmeaGps(NmeaSettings(), PortSettings(str(link), "gps", baud, "nmea"), asyncio.get_running_loop().time)


def run(talker: Callable[[], Talker], test: Callable[[Talker], Awaitable[None]]) -> None:
    async def main() -> None:
        one = talker()
        life = asyncio.create_task(one.serve())
        try:
            await test(one)
        finally:
            life.cancel()
            await asyncio.wait({life})
            one.wire.unplug()

    asyncio.run(main())


@pytest.fixture
def link(tmp_path: Path) -> Path:
    return tmp_path / "gps"


def refusal(
    link: Path, says: Callable[[int], bytes], baud: int = BAUD, talks_at: int = BAUD, every_s: float = 0.1
) -> DeviceError:
    """The error of opening, which came in time, with nothing written."""
    errors: list[DeviceError] = []

    async def test(talker: Talker) -> None:
        began_s = time.monotonic()
        with pytest.raises(DeviceError) as error:
            await device_at(link, baud).open()
        assert time.monotonic() - began_s < OPENS_WITHIN_S + SLACK_S
        assert talker.heard == b""
        errors.append(error.value)

    run(lambda: Talker(link, says, every_s, talks_at), test)
    return errors[0]


def test_silence_is_a_missing_receiver(link: Path) -> None:
    error = refusal(link, lambda number: b"")
    assert type(error) is DeviceMissing
    assert "silence" in error.found
    assert "power" in error.remedy


LOOKS = [
    (bytes.fromhex("fffffd00010700550000060421"), "Dynamixel"),
    (b"\r\n+CREG: 1\r\n\r\nRING\r\n", "modem"),
    (bytes.fromhex("b5620107") + bytes(range(96)), "UBX"),
    (bytes.fromhex("d300133ed7d3020298"), "RTCM"),
    (b"$@\x12\x34\x00\x01\x02\x03", "SBF"),
    (b"\xa0\xa2\x00\x12", "SiRF"),
    (b"!AIVDM,1,1,,A,14eG;o@034o8sd<L9i:a;WF>062D,0*7D", "AIS"),
    (b"\xfe\x91Booting\r\nkernel 5.10 loads its modules in order\r\n", "text: 'kernel 5.10"),
    (b"$GPGGA,100000,4807.0,N,01131.0,E,1,08,0.9,545.4,M,,,,\r\n", "without checksums"),
    (bytes((7 * k * k + 91 * k) & 0xFF for k in range(400)), "400 bytes that make no sense"),
    (b"", "silence"),
]


@pytest.mark.parametrize(("data", "words"), LOOKS, ids=[words for _, words in LOOKS])
def test_bytes_are_told_by_their_looks(data: bytes, words: str) -> None:
    assert words in looks_like(data)


@given(st.binary(max_size=300))
def test_any_bytes_look_like_something(data: bytes) -> None:
    assert looks_like(data).isprintable()


WRONG: list[tuple[Callable[[int], bytes], str]] = [
    (lambda number: LOOKS[0][0], "Dynamixel"),
    (lambda number: bytes((number * 7 + k * 53) & 0xFF for k in range(40)), "make no sense"),
    (lambda number: sentence("SDDPT,2.1,0.0") + sentence("HCHDG,101.1,,,7.1,W"), "HCHDG SDDPT only"),
]


@pytest.mark.parametrize(("says", "words"), WRONG, ids=[words for _, words in WRONG])
def test_another_device_is_told_by_what_it_says(link: Path, says: Callable[[int], bytes], words: str) -> None:
    error = refusal(link, says)
    assert type(error) is WrongDevice
    assert words in error.found
    assert "115200 baud" in error.expected


@pytest.mark.parametrize(
    ("asked", "true", "every_s"), [(115_200, 9600, 1.0), (9600, 115_200, 0.2), (9600, 38_400, 1.0)]
)
def test_a_wrong_baud_rate_is_named_with_the_right_one(link: Path, asked: int, true: int, every_s: float) -> None:
    error = refusal(link, lambda number: 3 * burst(number), asked, true, every_s)
    assert type(error) is WrongDevice
    assert error.found == f"NMEA at {true} baud"
    assert str(true) in error.remedy


def test_a_port_that_is_not_there_and_one_that_is_held_are_named(link: Path) -> None:
    async def test(talker: Talker) -> None:
        with pytest.raises(DeviceMissing, match="nowhere"):
            await device_at(link.with_name("nowhere")).open()
        first, second = device_at(link), device_at(link)
        await first.open()
        with pytest.raises(DeviceBusy):
            await second.open()
        await first.close()

    run(lambda: Talker(link, burst), test)


def test_a_receiver_that_comes_back_is_read_on(link: Path) -> None:
    async def test(talker: Talker) -> None:
        device = device_at(link)
        await device.open()
        await device.next_fix()
        talker.wire.unplug()
        await lost(device)
        with pytest.raises(DeviceLost, match="plug it in again"):
            await device.next_fix()
        talker.wire.plug()
        end_s = time.monotonic() + 20.0
        while not device.port.connected:
            assert time.monotonic() < end_s
            await asyncio.sleep(0.02)
        assert (await device.next_fix()).quality is FixQuality.RTK_FIXED
        assert talker.heard == b""
        await device.close()

    run(lambda: Talker(link, burst), test)


@pytest.mark.long
def test_a_receiver_that_loses_its_positions_garbles_or_falls_silent_is_told_apart(link: Path) -> None:
    states: dict[str, Callable[[int], bytes]] = {
        "others": lambda number: sentence("GNTXT,01,01,02,hello"),
        "garbled": lambda number: burst(number).replace(b",", b";"),
        "silent": lambda number: b"",
    }

    async def test(talker: Talker) -> None:
        device = device_at(link)
        await device.open()
        await device.next_fix()
        for state, kind, words in (
            ("others", DeviceFault, "other sentences only"),
            ("garbled", DeviceFault, "garbled"),
            ("silent", DeviceTimeout, "silence"),
        ):
            talker.says = states[state]
            await asyncio.sleep(0.3)
            with pytest.raises(kind, match=words):
                await device.next_fix()
            talker.says = burst
            await device.next_fix()
        assert (await device.next_fix()).quality is FixQuality.RTK_FIXED
        await device.close()

    run(lambda: Talker(link, burst), test)


def test_a_receiver_without_a_position_opens(link: Path) -> None:
    async def test(talker: Talker) -> None:
        device = device_at(link)
        await device.open()
        fix = await device.next_fix()
        assert (fix.quality, fix.latitude_deg, fix.utc) == (FixQuality.NONE, None, None)
        await device.close()

    nothing = sentence("GPRMC,,V,,,,,,,,,,N") + sentence("GPGGA,,,,,,0,00,99.99,,,,,,")
    run(lambda: Talker(link, lambda number: nothing), test)

"""What stands at the relay's place instead of the board: named within 3 s, and no coil is written."""

from __future__ import annotations

import asyncio
import os
import termios
import time
from collections.abc import Awaitable, Callable

import pytest

from drivers.emulation.bad_line import BadLine
from drivers.emulation.modbus_slave import ILLEGAL_FUNCTION, ModbusException, ModbusSlaves
from drivers.emulation.wire import PtyWire
from drivers.errors import DeviceError, DeviceMissing, DeviceTimeout, WrongDevice
from drivers.line import PortSettings
from drivers.modbus_master import ModbusMaster
from drivers.relay.emulator import emulated_board
from drivers.relay.modbus import ModbusRelay, RelaySettings
from drivers.relay.profiles import PROFILES
from drivers.serial_port import SerialPort
from tests.drivers.relay.boards import WIRED, Bench, Recorder, on_board
from tests.drivers.twin import rig

LONGEST_S = 3.0

# A driver for fewer channels, or for coils and no more, is at home on these too.
ALSO_FIT = {
    ("waveshare-8", "waveshare-poe-8"), ("waveshare-8", "waveshare-16"), ("waveshare-8", "waveshare-32"),
    ("waveshare-poe-8", "waveshare-8"), ("waveshare-poe-8", "waveshare-16"), ("waveshare-poe-8", "waveshare-32"),
    ("waveshare-16", "waveshare-32"),
    *(("generic-coils", name) for name in PROFILES if name not in ("r4d8a08", "wb-mr6")),
}  # fmt: skip
MISFITS = [(a, b) for a in PROFILES for b in PROFILES if a != b and (a, b) not in ALSO_FIT]


@pytest.mark.parametrize(("profile", "actual"), MISFITS)
def test_a_board_that_does_not_match_its_profile_is_refused(profile: str, actual: str) -> None:
    async def test(bench: Bench) -> None:
        with pytest.raises(WrongDevice, match=PROFILES[profile].title):
            await bench.relay.open()
        assert bench.trace.requests()
        assert bench.trace.writes() == []

    on_board(profile, test, actual=actual, opened=False)


def test_the_refusal_says_what_differed() -> None:
    async def test(bench: Bench) -> None:
        with pytest.raises(WrongDevice, match=r"its model at holding register 0x00c8.*illegal data address.*profile"):
            await bench.relay.open()

    on_board("wb-mr6", test, actual="waveshare-8", opened=False)


Talk = Callable[[PtyWire], Awaitable[None]]


async def _nothing(wire: PtyWire) -> None:
    """Says nothing by itself."""


def opened_on(
    receive: Callable[[PtyWire, bytes], None], talk: Talk = _nothing, baud: int = 115200
) -> tuple[DeviceError, Recorder, float]:
    """What opening a Waveshare relay says of whatever hears with ``receive`` and speaks with ``talk``."""
    trace = Recorder()

    async def main() -> tuple[DeviceError, float]:
        wire = PtyWire(baud, lambda data: receive(wire, data))
        wire.plug()
        clock = asyncio.get_running_loop().time
        port = SerialPort(PortSettings(wire.path, "relay", baud, "modbus"), clock, trace=trace)  # type: ignore[arg-type]
        relay = ModbusRelay(RelaySettings("waveshare-8", 1, WIRED), ModbusMaster(port), clock)
        talking = asyncio.ensure_future(talk(wire))
        start_s = time.monotonic()
        with pytest.raises(DeviceError) as told:
            await relay.open()
        took_s = time.monotonic() - start_s
        talking.cancel()
        wire.unplug()
        return told.value, took_s

    error, took_s = asyncio.run(main())
    assert trace.writes() == []
    assert took_s < LONGEST_S
    return error, trace, took_s


def test_silence_is_a_missing_device_and_names_what_to_check() -> None:
    error, _, _ = opened_on(lambda wire, data: None)
    assert isinstance(error, DeviceMissing)
    assert "unit id and baud rate" in error.remedy


def test_a_receiver_that_talks_is_no_relay() -> None:
    async def talk(wire: PtyWire) -> None:
        while True:
            wire.send(b"$GPRMC,101530.00,A,4739.6,N,00910.5,E,0.1,,150626,,,A*00\r\n")
            await asyncio.sleep(0.02)

    error, _, _ = opened_on(lambda wire, data: None, talk)
    assert isinstance(error, WrongDevice)
    assert "24 47 50 52 4d 43" in error.found  # $GPRMC


def test_a_servo_that_answers_to_its_own_protocol_only_is_silent() -> None:
    def servo(wire: PtyWire, data: bytes) -> None:
        if b"\xff\xff\xfd\x00" in data:
            wire.send(bytes.fromhex("ff ff fd 00 01 07 00 55 00 06 04 26 65 5d"))

    error, _, _ = opened_on(servo)
    assert isinstance(error, DeviceMissing)


def test_an_echoing_line_is_no_relay() -> None:
    error, _, _ = opened_on(lambda wire, data: wire.send(data))
    assert isinstance(error, WrongDevice)
    assert "garbled" in error.found


def test_another_modbus_device_is_no_relay() -> None:
    class Meter:
        def answer(self, function: int, data: bytes) -> bytes | None:
            raise ModbusException(ILLEGAL_FUNCTION)

    slaves: list[ModbusSlaves] = []

    def receive(wire: PtyWire, data: bytes) -> None:
        if not slaves:
            clock = asyncio.get_running_loop().time
            slaves.append(ModbusSlaves(clock, wire.byte_s))
            slaves[0].add(1, Meter(), BadLine("relay", rig.twin(), clock, wire.send, wire.byte_s))
        slaves[0].receive(data)

    error, _, _ = opened_on(receive)
    assert isinstance(error, WrongDevice)
    assert "illegal function" in error.found


def test_two_boards_with_one_id_are_noticed() -> None:
    async def test(bench: Bench) -> None:
        twin = rig.twin()
        line = BadLine("relay", twin, bench.clock, bench.bus.wire.send, bench.bus.wire.byte_s)
        bench.bus.slaves.add(1, emulated_board("waveshare-8", 1, twin, bench.clock, WIRED), line)
        start_s = time.monotonic()
        with pytest.raises(WrongDevice, match="id"):
            await bench.relay.open()
        assert time.monotonic() - start_s < LONGEST_S
        assert bench.trace.writes() == []

    on_board("waveshare-8", test, opened=False)


@pytest.mark.parametrize("host_baud", [9600, 57600])
def test_a_wrong_baud_rate_is_told_within_the_time(host_baud: int) -> None:
    """Bytes of another rate are other bytes: what the board hears has no right checksum."""

    async def test(bench: Bench) -> None:
        bench.bus.slaves.broken_bytes = 0
        port = SerialPort(PortSettings(bench.bus.wire.path, "relay", host_baud, "modbus"), bench.clock)
        relay = ModbusRelay(bench.settings, ModbusMaster(port), bench.clock)
        receive = bench.bus.slaves.receive
        bench.bus.wire._receive = lambda data: receive(_as_heard(bench.bus.wire, data))
        start_s = time.monotonic()
        with pytest.raises(DeviceMissing, match="baud rate"):
            await relay.open()
        assert time.monotonic() - start_s < LONGEST_S
        assert bench.bus.slaves.broken_bytes > 0

    on_board("waveshare-8", test, opened=False)


def _as_heard(wire: PtyWire, data: bytes) -> bytes:
    """The bytes that a board of 115200 baud sees when the host sends at the rate that it has set."""
    descriptor = os.open(wire.path, os.O_RDONLY | os.O_NOCTTY)
    try:
        speed = termios.tcgetattr(descriptor)[4]
    finally:
        os.close(descriptor)
    return data if speed == termios.B115200 else bytes((byte * 7 + 0x80) & 0xFF for byte in data)


def test_a_port_that_is_not_there_is_named() -> None:
    async def main() -> None:
        clock = asyncio.get_running_loop().time
        port = SerialPort(PortSettings("/dev/serial/by-id/no-such-relay", "relay", 9600, "modbus"), clock)
        with pytest.raises(DeviceMissing, match="no-such-relay, found nothing there"):
            await ModbusRelay(RelaySettings("waveshare-8", 1, WIRED), ModbusMaster(port), clock).open()

    asyncio.run(main())


def test_a_board_that_falls_silent_while_it_is_greeted_is_told_within_the_time() -> None:
    async def test(bench: Bench) -> None:
        await asyncio.sleep(1.0)
        start_s = time.monotonic()
        with pytest.raises((DeviceMissing, DeviceTimeout, WrongDevice)):
            await bench.relay.open()
        assert time.monotonic() - start_s < LONGEST_S

    on_board("r4d8a08", test, "relay:off@1.02s", opened=False)


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({"profile": "waveshare-9"}, "known are waveshare-8"),
        ({"unit_id": 0}, "unit_id"),
        ({"channels": {}}, "at least one channel"),
        ({"lease_s": 0.1}, r"lease_s: expected 0\.2 s or more"),
        ({"longest_pulse_s": float("inf")}, "longest_pulse_s"),
        ({"reply_timeout_s": 0.0}, "reply_timeout_s"),
        ({"channels": {next(iter(WIRED)): 9}}, "expected 1 to 8, found 9"),
    ],
)
def test_settings_that_cannot_be_are_refused(changes: dict[str, object], why: str) -> None:
    told: dict[str, object] = {"profile": "waveshare-8", "unit_id": 1, "channels": WIRED}
    with pytest.raises(ValueError, match=why):
        RelaySettings(**told | changes)  # type: ignore[arg-type]


def test_two_channels_on_one_relay_are_refused() -> None:
    with pytest.raises(ValueError, match="found 1 twice"):
        RelaySettings("waveshare-8", 1, dict.fromkeys(WIRED, 1))

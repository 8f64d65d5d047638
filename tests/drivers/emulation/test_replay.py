"""A session that was recorded with a driver and its emulator is played back to a fresh driver: it goes the same way."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.byte_trace import ByteTrace, Chunk, TraceHead, read_trace
from drivers.emulation.bad_line import BadLine
from drivers.emulation.reference_bus import REFERENCE_BAUD, REFERENCE_BOARD, REFERENCE_WIRING, ReferenceBus
from drivers.emulation.replay import Replay, ReplayDeviation
from drivers.emulation.wire import PtyWire
from drivers.errors import DeviceError, DeviceTimeout
from drivers.gps.emulator import GpsEmulator
from drivers.gps.nmea import NmeaGps, NmeaSettings
from drivers.gps.values import Fix
from drivers.line import PortSettings
from drivers.modbus_master import ModbusMaster
from drivers.modem.emulator import ModemEmulator
from drivers.modem.gsm import GsmModem
from drivers.modem.gsm_settings import GsmSettings
from drivers.relay.modbus import ModbusRelay, RelaySettings
from drivers.relay.values import Channel
from drivers.serial_port import SerialPort
from tests.drivers.twin import rig

BAUD = 115_200
SAYS: list[Chunk] = [
    Chunk(1.0, "out", b"who"), Chunk(1.1, "out", b"?"), Chunk(1.2, "in", b"it is"), Chunk(1.3, "in", b" me"),
    Chunk(2.0, "out", b"bye"),
]  # fmt: skip


class Spoken:
    """Where a replay speaks to."""

    def __init__(self, chunks: list[Chunk], byte_s: float = 0.0) -> None:
        self.said: list[tuple[bytes, float]] = []
        self.replay = Replay(chunks, byte_s)
        self.replay.connect(lambda data, delay_s: self.said.append((data, round(delay_s, 6))))


# --- the peer by itself


def test_it_answers_as_it_did_when_it_did() -> None:
    spoken = Spoken(SAYS)
    spoken.replay.receive(b"w")
    assert spoken.said == []
    spoken.replay.receive(b"ho?")
    assert spoken.said == [(b"it is", 0.1), (b" me", 0.2)]
    assert not spoken.replay.done
    spoken.replay.receive(b"bye")
    assert spoken.replay.done
    spoken.replay.require_done()


def test_an_answer_begins_by_its_own_time_on_the_wire_earlier() -> None:
    spoken = Spoken(SAYS, byte_s=0.01)
    spoken.replay.receive(b"who?")
    assert spoken.said == [(b"it is", 0.05), (b" me", 0.17)]


def test_what_was_said_unasked_at_first_comes_at_once() -> None:
    spoken = Spoken([Chunk(5.0, "in", b"RDY"), Chunk(5.5, "in", b"+CMTI"), *SAYS])
    assert spoken.said == [(b"RDY", 0.0), (b"+CMTI", 0.5)]


def test_a_host_that_says_something_else_is_told_where_and_gets_no_answer_more() -> None:
    spoken = Spoken(SAYS)
    spoken.replay.receive(b"who?bxe")
    spoken.said.clear()
    spoken.replay.receive(b"bye")
    assert spoken.said == []
    assert not spoken.replay.done
    with pytest.raises(ReplayDeviation, match=r"byte 5: expected 79 65 \(at 2\.000000 s of the trace\), found 78 65"):
        spoken.replay.require_done()


def test_a_host_that_goes_on_when_the_session_is_over_is_told_so() -> None:
    spoken = Spoken(SAYS)
    spoken.replay.receive(b"who?byeand")
    with pytest.raises(ReplayDeviation, match=r"byte 7: expected nothing more, found 61 6e 64"):
        spoken.replay.require_done()


def test_a_host_that_says_less_is_told_what_was_to_come() -> None:
    spoken = Spoken(SAYS)
    spoken.replay.receive(b"who?b")
    with pytest.raises(ReplayDeviation, match=r"after 5 bytes: expected 79 65 \(at 2\.000000 s"):
        spoken.replay.require_done()


CHUNKS = st.lists(
    st.builds(
        Chunk, st.floats(0, 10, allow_nan=False), st.sampled_from(["in", "out"]), st.binary(min_size=1, max_size=9)
    ),
    max_size=12,
)


@given(CHUNKS, st.lists(st.integers(1, 7), min_size=1, max_size=20))
def test_a_faithful_host_hears_all_however_it_cuts_what_it_says(chunks: list[Chunk], cuts: list[int]) -> None:
    spoken = Spoken(chunks)
    says = b"".join(chunk.data for chunk in chunks if chunk.direction == "out")
    while says:
        cut = cuts[len(says) % len(cuts)]
        spoken.replay.receive(says[:cut])
        says = says[cut:]
    spoken.replay.require_done()
    heard = b"".join(data for data, _ in spoken.said)
    assert heard == b"".join(chunk.data for chunk in chunks if chunk.direction == "in")


@given(CHUNKS, st.data())
def test_any_other_byte_is_noticed(chunks: list[Chunk], data: st.DataObject) -> None:
    says = bytearray(b"".join(chunk.data for chunk in chunks if chunk.direction == "out"))
    if says:
        place = data.draw(st.integers(0, len(says) - 1))
        says[place] ^= data.draw(st.integers(1, 255))
        spoken = Spoken(chunks)
        spoken.replay.receive(bytes(says))
        with pytest.raises(ReplayDeviation, match=f"byte {place}:"):
            spoken.replay.require_done()


# --- sessions of drivers


def recorded(path: Path, session: Callable[[Callable[[], float], ByteTrace], Awaitable[object]]) -> object:
    async def main() -> object:
        trace = ByteTrace(path, TraceHead("device", "raw", "", BAUD))
        try:
            return await session(asyncio.get_running_loop().time, trace)
        finally:
            trace.close()

    return asyncio.run(main())


def replayed(path: Path, session: Callable[[Callable[[], float], str], Awaitable[object]]) -> object:
    """The session's result over the recorded bytes, which must all have been used."""

    async def main() -> object:
        replay = Replay(read_trace(path)[1], 10.0 / BAUD)
        wire = PtyWire(BAUD, replay.receive)
        wire.plug()
        replay.connect(wire.send)
        try:
            result = await session(asyncio.get_running_loop().time, wire.path)
        finally:
            wire.unplug()
        replay.require_done()
        return result

    return asyncio.run(main())


def relay_at(path: str, clock: Callable[[], float], trace: ByteTrace | None = None) -> ModbusRelay:
    port = SerialPort(PortSettings(path, "relay", BAUD, "modbus"), clock, trace=trace)
    return ModbusRelay(RelaySettings(REFERENCE_BOARD, 1, REFERENCE_WIRING), ModbusMaster(port, 0.5), clock)


async def use_relay(relay: ModbusRelay) -> list[object]:
    """Something of each kind; what it tells but for the moments, which are the run's own."""
    await relay.open()
    receipt = await relay.pulse(Channel.VALVE, 0.3)
    on = dict((await relay.read()).coils)
    await relay.cancel(Channel.VALVE)
    await relay.switch(Channel.LAMP, True)
    lit = dict((await relay.read()).coils)
    await relay.close()
    return [receipt.duration_s, on, lit, relay.capability]


def record_relay(path: Path) -> list[object]:
    async def session(clock: Callable[[], float], trace: ByteTrace) -> list[object]:
        bus = ReferenceBus(rig.twin(), clock, baud=REFERENCE_BAUD)
        bus.wire.plug()
        return await use_relay(relay_at(bus.wire.path, clock, trace))

    told = recorded(path, session)
    assert isinstance(told, list)
    return told


def test_a_session_of_the_relay_goes_the_same_way_again(tmp_path: Path) -> None:
    told = record_relay(tmp_path / "trace")
    assert told[1] != told[2]

    async def session(clock: Callable[[], float], path: str) -> list[object]:
        return await use_relay(relay_at(path, clock))

    assert replayed(tmp_path / "trace", session) == told


def test_a_driver_that_does_something_else_is_told_where(tmp_path: Path) -> None:
    record_relay(tmp_path / "trace")

    async def session(clock: Callable[[], float], path: str) -> None:
        relay = relay_at(path, clock)
        await relay.open()
        with pytest.raises(DeviceTimeout):
            await relay.pulse(Channel.VALVE, 0.4)
        with pytest.raises(DeviceError):
            await relay.close()

    with pytest.raises(ReplayDeviation, match=r"expected 03 .* found 04 "):
        replayed(tmp_path / "trace", session)


async def quiet(modem: GsmModem, for_s: float = 0.7) -> None:
    """Until the driver has done what it does by itself."""
    jobs = -1
    while modem.port.busy or jobs != modem.port.statistics.jobs:
        jobs = modem.port.statistics.jobs
        await asyncio.sleep(for_s)


async def use_modem(modem: GsmModem) -> list[object]:
    await modem.open()
    await quiet(modem)
    status = await modem.status()
    await modem.send("+31612345678", "row A: 12 fruits, 48 ml — done")
    await quiet(modem)
    await modem.close()
    return [status.sim_ready, status.registered, status.operator, status.signal_dbm, modem.model]


@pytest.mark.long
def test_a_session_of_the_modem_goes_the_same_way_again(tmp_path: Path) -> None:
    settings = GsmSettings(poll_s=600.0)

    async def record(clock: Callable[[], float], trace: ByteTrace) -> list[object]:
        twin = rig.twin()
        emulator = ModemEmulator(twin, clock)
        wire = PtyWire(BAUD, emulator.receive)
        emulator.connect(BadLine("modem", twin, clock, wire.send, wire.byte_s))
        wire.plug()
        serving = asyncio.ensure_future(emulator.serve())
        port = PortSettings(wire.path, "modem", BAUD, "at")
        told = await use_modem(GsmModem.on_port(settings, port, clock, trace=trace))
        serving.cancel()
        return told

    told = recorded(tmp_path / "trace", record)

    async def replay(clock: Callable[[], float], path: str) -> list[object]:
        return await use_modem(GsmModem.on_port(settings, PortSettings(path, "modem", BAUD, "at"), clock))

    assert replayed(tmp_path / "trace", replay) == told


async def fixes(gps: NmeaGps, count: int) -> list[Fix]:
    await gps.open()
    told = [await gps.next_fix() for _ in range(count)]
    await gps.close()
    return told


def test_what_a_receiver_said_gives_the_same_fixes_again(tmp_path: Path) -> None:
    async def record(clock: Callable[[], float], trace: ByteTrace) -> list[Fix]:
        twin = rig.twin()
        emulator = GpsEmulator(twin, clock)
        wire = PtyWire(BAUD, emulator.receive)
        emulator.connect(BadLine("gps", twin, clock, wire.send, wire.byte_s))
        wire.plug()
        serving = asyncio.ensure_future(emulator.serve())
        told = await fixes(NmeaGps(NmeaSettings(), PortSettings(wire.path, "gps", BAUD, "nmea"), clock, trace), 8)
        serving.cancel()
        return told

    told = recorded(tmp_path / "trace", record)
    assert isinstance(told, list)

    async def replay(clock: Callable[[], float], path: str) -> list[Fix]:
        return await fixes(NmeaGps(NmeaSettings(), PortSettings(path, "gps", BAUD, "nmea"), clock), 3)

    again = replayed(tmp_path / "trace", replay)
    assert isinstance(again, list)
    first = [fix.utc for fix in told].index(again[0].utc)  # what came before the port was open was not heard
    then = [replace(fix, stamp_s=0.0) for fix in told[first : first + 3]]
    assert [replace(fix, stamp_s=0.0) for fix in again] == then

"""The client of a caster, over real sockets."""

from __future__ import annotations

import asyncio
import base64
import ssl
import subprocess
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from drivers.emulation.bad_line import BadLine
from drivers.emulation.wire import PtyWire
from drivers.errors import DeviceLost
from drivers.gps import ntrip
from drivers.gps.base_station import BaseStation
from drivers.gps.caster import Caster, CasterFault, CasterSettings
from drivers.gps.corrected import CorrectedGps
from drivers.gps.emulator import EmulatedReceiver, GpsEmulator
from drivers.gps.nmea import NmeaGps, NmeaSettings
from drivers.gps.ntrip import NtripClient, NtripSettings
from drivers.gps.ntrip_talk import request
from drivers.gps.rtcm import RtcmFramer
from drivers.gps.values import FixQuality
from drivers.line import PortSettings
from tests.drivers.twin import rig

BASE = BaseStation(47.6605, 9.1755, 452.0)
GGA = b"$GNGGA,100000.00,4739.6000000,N,00910.5000000,E,4,18,0.70,404.000,M,0.000,M,1.0,0001*4B"
OPEN = CasterSettings({"FIELD": BASE, "SHORE": BASE}, {}, interval_s=0.05)
CLOSED = replace(OPEN, users={"anna": "s3cret"})
PLACE = NtripSettings("127.0.0.1", "FIELD", gga_every_s=0.1, timeout_s=1.0)


class Receiver:
    """Takes corrections."""

    def __init__(self) -> None:
        self.got = b""
        self.gga = GGA
        self.lost = False

    async def feed(self, data: bytes) -> None:
        if self.lost:
            raise DeviceLost("gps", "its port to be there", "it gone", "plug it in again")
        self.got += data

    @property
    def frames(self) -> int:
        return len(RtcmFramer().feed(self.got))


@pytest.fixture(autouse=True)
def short_pauses(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ntrip, "FIRST_PAUSE_S", 0.05)


@asynccontextmanager
async def connected(
    settings: NtripSettings, receiver: Receiver, port: int, **changes: Any
) -> AsyncIterator[NtripClient]:
    loop = asyncio.get_running_loop()
    client = NtripClient(
        replace(settings, port=port, **changes), receiver.feed, lambda: receiver.gga, loop.time
    )  # fmt: skip
    life = asyncio.create_task(client.run())
    try:
        yield client
        assert not life.done(), life
    finally:
        life.cancel()
        await asyncio.wait({life})


@asynccontextmanager
async def caster_of(settings: CasterSettings, tls: ssl.SSLContext | None = None) -> AsyncIterator[tuple[Caster, int]]:
    caster = Caster(settings, asyncio.get_running_loop().time)
    port = await caster.start(tls=tls)
    try:
        yield caster, port
    finally:
        await caster.stop()


@asynccontextmanager
async def server_that(
    answers: Callable[[asyncio.StreamReader, asyncio.StreamWriter], Awaitable[None]],
) -> AsyncIterator[int]:
    """A peer that does just this with each connection."""

    async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        try:
            await reader.readuntil(b"\r\n\r\n")
            await answers(reader, writer)
        except (OSError, asyncio.IncompleteReadError):
            pass
        finally:
            writer.transport.abort()

    server = await asyncio.start_server(serve, "127.0.0.1", 0)
    try:
        yield server.sockets[0].getsockname()[1]
    finally:
        server.close()


async def until(condition: Callable[[], object], longest_s: float = 20.0) -> None:
    end_s = asyncio.get_running_loop().time() + longest_s
    while not condition():
        assert asyncio.get_running_loop().time() < end_s, "waited in vain"
        await asyncio.sleep(0.005)


@pytest.mark.parametrize("version", [1, 2])
def test_corrections_of_either_version_reach_the_receiver_whole(version: int) -> None:
    async def main() -> None:
        receiver = Receiver()
        async with (
            caster_of(replace(CLOSED, version=version)) as (caster, port),
            connected(PLACE, receiver, port, user="anna", password="s3cret") as client,
        ):
            await until(lambda: receiver.frames >= 12)
            assert client.status.connected
            assert client.status.frames >= 12
            assert client.status.error == ""
            assert client.rtcm.bad_checksums == 0
            assert "Ntrip-Version: Ntrip/2.0" in caster.requests[0]
            assert base64.b64encode(b"anna:s3cret").decode() in caster.requests[0]

    asyncio.run(main())


def test_the_rovers_position_goes_up_again_and_again() -> None:
    async def main() -> None:
        receiver = Receiver()
        receiver.gga = b""
        async with caster_of(OPEN) as (caster, port), connected(PLACE, receiver, port):
            await until(lambda: receiver.frames)
            assert not caster.positions
            receiver.gga = GGA
            await until(lambda: len(caster.positions) >= 3)
            assert set(caster.positions) == {GGA}

    asyncio.run(main())


REFUSALS = [
    ({"password": "wrong", "user": "anna"}, "401 Unauthorized", "check user and password"),
    (
        {"mountpoint": "MEADOW", "user": "anna", "password": "s3cret"},
        "no such mountpoint; it has FIELD, SHORE",
        "correct",
    ),
]


@pytest.mark.parametrize("version", [1, 2])
@pytest.mark.parametrize(("changes", "found", "remedy"), REFUSALS, ids=["password", "mountpoint"])
def test_a_refusal_is_told_with_its_remedy(version: int, changes: dict[str, str], found: str, remedy: str) -> None:
    async def main() -> None:
        receiver = Receiver()
        async with (
            caster_of(replace(CLOSED, version=version)) as (_, port),
            connected(PLACE, receiver, port, **changes) as client,
        ):
            await until(lambda: found in client.status.error)
            assert remedy in client.status.error
            assert not client.status.connected
            assert receiver.got == b""

    asyncio.run(main())


ANSWERS = [
    (b"HTTP/1.1 404 Not Found\r\n\r\n", "no such mountpoint"),
    (b"HTTP/1.1 403 Forbidden\r\n\r\n", "403 Forbidden"),
    (b"HTTP/1.1 503 Busy\r\n\r\n", "503 Busy"),
    (b"SSH-2.0-OpenSSH_9.2\r\n", "SSH-2.0"),
    (b"HTTP/1.1 200 OK\r\n" + 200 * b"X: y\r\n" + b"\r\n", "headers without end"),
    (b"HTTP/1.1 200 OK\r\nTransfer-Encoding: chunked\r\n\r\nzz\r\n", "something else"),
    (b"x" * 20_000, "check host and port"),
    (b"HTTP/1.1 200 OK\r\nContent-Type: gnss/data\r\n\r\n", "its end"),
]


@pytest.mark.parametrize(("answer", "words"), ANSWERS, ids=[words for _, words in ANSWERS])
def test_any_answer_is_told_for_what_it_is(answer: bytes, words: str) -> None:
    async def say(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        writer.write(answer)
        await writer.drain()
        writer.close()
        await writer.wait_closed()

    async def main() -> None:
        async with server_that(say) as port, connected(PLACE, Receiver(), port) as client:
            await until(lambda: words in client.status.error)

    asyncio.run(main())


def test_a_caster_that_hangs_up_on_version_2_is_asked_in_version_1() -> None:
    asked: list[bytes] = []

    async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        asked.append(head := await reader.readuntil(b"\r\n\r\n"))
        if b"HTTP/1.0" in head:
            writer.write(b"ICY 200 OK\r\n" + b"".join(BASE.epoch(0.0)))  # no empty line, as some do
            await writer.drain()
            await reader.read()
        writer.transport.abort()

    async def main() -> None:
        server = await asyncio.start_server(serve, "127.0.0.1", 0)
        receiver = Receiver()
        async with connected(PLACE, receiver, server.sockets[0].getsockname()[1]) as client:
            await until(lambda: receiver.frames == 3)
            assert client.status.version == 1
            assert [head.split(b"\r\n")[0] for head in asked[:2]] == [b"GET /FIELD HTTP/1.1", b"GET /FIELD HTTP/1.0"]
        server.close()

    asyncio.run(main())


def test_silence_of_a_caster_is_noticed_and_it_is_connected_anew() -> None:
    async def main() -> None:
        receiver = Receiver()
        async with caster_of(OPEN) as (caster, port), connected(PLACE, receiver, port, timeout_s=0.4) as client:
            await until(lambda: client.status.connected)
            caster.fault = CasterFault.STALL
            await until(lambda: "corrections of 127.0.0.1" in client.status.error)
            assert not client.status.connected
            caster.fault = CasterFault.OK
            await until(lambda: client.status.connected)
            assert client.status.connections >= 2

    asyncio.run(main())


def test_a_dropped_connection_is_made_anew_and_loses_no_whole_frame() -> None:
    async def main() -> None:
        receiver = Receiver()
        async with caster_of(OPEN) as (caster, port), connected(PLACE, receiver, port) as client:
            await until(lambda: receiver.frames >= 3)
            caster.fault = CasterFault.DROP
            await until(lambda: "its end" in client.status.error)
            caster.fault = CasterFault.OK
            before = receiver.frames
            await until(lambda: receiver.frames >= before + 3)
            assert RtcmFramer().feed(receiver.got)
            framer = RtcmFramer()
            framer.feed(receiver.got)
            assert framer.statistics.stray_bytes == 0

    asyncio.run(main())


def test_garbled_corrections_never_reach_the_receiver() -> None:
    async def main() -> None:
        receiver = Receiver()
        async with caster_of(OPEN) as (caster, port):
            caster.fault = CasterFault.GARBAGE
            async with connected(PLACE, receiver, port, timeout_s=0.5) as client:
                await until(lambda: "bytes that are not RTCM 3" in client.status.error)
                assert receiver.got == b""

    asyncio.run(main())


def test_an_unplugged_receiver_does_not_end_the_client() -> None:
    async def main() -> None:
        receiver = Receiver()
        async with caster_of(OPEN) as (_, port), connected(PLACE, receiver, port) as client:
            await until(lambda: receiver.frames)
            receiver.lost = True
            await until(lambda: client.status.undelivered)
            assert "plug it in again" in client.status.error
            receiver.lost = False
            before = receiver.frames
            await until(lambda: receiver.frames > before)
            assert client.status.error == ""
            assert client.status.connections == 1

    asyncio.run(main())


def test_pauses_grow_to_a_minute_and_shrink_after_a_success(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.undo()
    pauses: list[float] = []
    real_sleep = asyncio.sleep

    async def sleep(pause_s: float) -> None:
        pauses.append(pause_s)
        await real_sleep(0.0)

    async def main() -> None:
        client = NtripClient(replace(PLACE, port=1), Receiver().feed, lambda: b"", asyncio.get_running_loop().time)
        monkeypatch.setattr(ntrip.asyncio, "sleep", sleep)
        life = asyncio.create_task(client.run())
        while len(pauses) < 12:
            await real_sleep(0.005)
        life.cancel()
        await asyncio.wait({life})
        assert "a caster at 127.0.0.1:1" in client.status.error

    asyncio.run(main())
    for number, pause_s in enumerate(pauses[:12]):
        full_s = min(60.0, 2.0**number)
        assert 0.5 * full_s <= pause_s <= full_s
    assert len({round(pause_s / min(60.0, 2.0**n), 6) for n, pause_s in enumerate(pauses[:12])}) > 6, "no jitter"


@pytest.mark.long
def test_a_receiver_on_a_caster_comes_to_a_fixed_solution_and_loses_it_with_the_caster() -> None:
    """Driver, client, caster and emulated receiver together."""

    async def main() -> None:
        loop = asyncio.get_running_loop()
        begun_s = loop.time()
        twin = rig.twin()
        emulator = GpsEmulator(twin, lambda: loop.time() - begun_s, EmulatedReceiver(needs_corrections=True))
        wire = PtyWire(115_200, emulator.receive)
        emulator.connect(BadLine("gps", twin, lambda: loop.time() - begun_s, wire.send, wire.byte_s))
        wire.plug()
        serving = asyncio.create_task(emulator.serve())
        async with caster_of(CLOSED) as (caster, port):
            settings = replace(PLACE, port=port, user="anna", password="s3cret", timeout_s=2.0)
            receiver = NmeaGps(NmeaSettings(), PortSettings(wire.path, "gps", 115_200, "nmea"), loop.time)
            device = CorrectedGps(receiver, settings, loop.time)
            await device.open()
            try:
                while (await device.next_fix()).quality is not FixQuality.RTK_FIXED:
                    assert loop.time() < begun_s + 20.0
                assert device.ntrip.connected
                assert emulator.corrections.frames >= 1
                assert emulator.corrections.stray_bytes == 0
                await until(lambda: caster.positions)
                assert caster.positions[-1].startswith(b"$GNGGA,")
                caster.fault = CasterFault.STALL
                while (await device.next_fix()).quality is FixQuality.RTK_FIXED:
                    assert loop.time() < begun_s + 60.0
                assert (await device.next_fix()).quality is FixQuality.RTK_FLOAT
                await until(lambda: not device.ntrip.connected)
            finally:
                await device.close()
        serving.cancel()
        await asyncio.wait({serving})
        wire.unplug()

    asyncio.run(main())


# --- TLS


@pytest.fixture(scope="module")
def certificate(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """For localhost, signed by itself; key and certificate in one file."""
    file = tmp_path_factory.mktemp("tls") / "caster.pem"
    command = ["openssl", "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-days", "2", "-subj", "/CN=localhost",
               "-addext", "subjectAltName=DNS:localhost", "-keyout", "key.pem", "-out", "cert.pem"]  # fmt: skip
    try:
        subprocess.run(command, cwd=file.parent, check=True, capture_output=True)
    except FileNotFoundError:
        pytest.skip("openssl is not installed (apt openssl)")
    file.write_bytes((file.parent / "key.pem").read_bytes() + (file.parent / "cert.pem").read_bytes())
    return file


@pytest.mark.parametrize(
    ("host", "trusted", "found"),
    [
        ("localhost", True, ""),
        ("localhost", False, "self-signed certificate"),
        ("127.0.0.1", True, "IP address mismatch"),
    ],
    ids=["right", "not trusted", "another name"],
)
def test_tls_checks_who_the_caster_is(certificate: Path, host: str, trusted: bool, found: str) -> None:
    async def main() -> None:
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        context.load_cert_chain(certificate)
        receiver = Receiver()
        changes = {"host": host, "tls": True, "tls_ca_file": certificate if trusted else None}
        async with caster_of(OPEN, context) as (_, port), connected(PLACE, receiver, port, **changes) as client:
            if found:
                await until(lambda: found in client.status.error)
                assert "trusted certificate" in client.status.error
                assert receiver.got == b""
            else:
                await until(lambda: receiver.frames)

    asyncio.run(main())


# --- settings


@pytest.mark.parametrize(
    "changes",
    [{"mountpoint": "A B"}, {"mountpoint": "A\r\nX: y"}, {"mountpoint": ""}, {"host": "a b"}, {"port": 0},
     {"user": "a:b"}, {"password": "a\r\nb"}, {"timeout_s": 0.0}, {"gga_every_s": -1.0}],
    ids=str,
)  # fmt: skip
def test_settings_that_cannot_be_asked_for_are_refused(changes: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match="ntrip: expected"):
        replace(PLACE, **changes)


def test_a_password_is_not_told_by_accident() -> None:
    assert "s3cret" not in repr(replace(PLACE, user="anna", password="s3cret"))


def test_a_position_is_asked_with_only_where_it_is_wanted() -> None:
    assert b"Ntrip-GGA: $GNGGA" in request(PLACE, 2, GGA)
    assert b"GGA" not in request(replace(PLACE, gga_every_s=0.0), 2, GGA)
    assert b"GGA" not in request(PLACE, 1, GGA)

"""gpsd reads our emulated receiver and agrees with our driver; gpsdecode reads the corrections of our base."""

from __future__ import annotations

import asyncio
import json
import shutil
import socket
import subprocess
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from drivers.emulation.bad_line import BadLine
from drivers.emulation.wire import PtyWire
from drivers.gps.base_station import BaseStation
from drivers.gps.emulator import EmulatedReceiver, GpsEmulator
from drivers.gps.epochs import Epoch, EpochAssembler
from drivers.gps.sentence_reader import SentenceReader
from drivers.gps.values import FixQuality
from drivers.twin import Twin
from drivers.twin import commands as c
from tests.drivers.twin import rig

pytestmark = pytest.mark.peer

BAUD = 115_200
LONGEST_S = 60.0
needs_gpsd = pytest.mark.skipif(
    shutil.which("gpsd") is None or shutil.which("gpspipe") is None, reason="no gpsd: apt install gpsd gpsd-clients"
)
needs_gpsdecode = pytest.mark.skipif(shutil.which("gpsdecode") is None, reason="no gpsdecode: apt install gpsd-clients")
RTK_STATUS = {FixQuality.DGPS: 2, FixQuality.RTK_FIXED: 3, FixQuality.RTK_FLOAT: 4}  # of gpsd; 1 is not written


@dataclass
class Bench:
    twin: Twin
    clock: Callable[[], float]
    reports: asyncio.StreamReader
    wire: PtyWire
    said: list[bytes]

    async def next_fixes(self, count: int) -> list[dict[str, Any]]:
        """gpsd's next reports with a time, of as many epochs, the last one of each."""
        found: dict[str, dict[str, Any]] = {}
        while len(found) <= count:
            line = await self.reports.readline()
            assert line, "gpspipe ended"
            report = json.loads(line)
            if report["class"] == "TPV" and "time" in report:
                found[report["time"]] = report
        return list(found.values())[:-1]

    def our_epochs(self) -> dict[str, Epoch]:
        """What our parser makes of the same bytes, by time."""
        reader, assembler = SentenceReader(self.wire.byte_s, capped=False), EpochAssembler()
        read = reader.feed(b"".join(self.said), 0.0)
        epochs = [epoch for began_s, sentence in read for epoch in assembler.add(sentence, began_s)]
        return {
            f"{epoch.utc:%Y-%m-%dT%H:%M:%S}.{epoch.utc.microsecond // 1000:03d}Z": epoch
            for epoch in epochs
            if epoch.utc is not None
        }


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@asynccontextmanager
async def read_by_gpsd(receiver: EmulatedReceiver, **changes: Any) -> AsyncIterator[Bench]:
    loop = asyncio.get_running_loop()
    begun_s = loop.time()

    def clock() -> float:
        return loop.time() - begun_s

    twin = rig.twin(**changes)
    emulator = GpsEmulator(twin, clock, receiver)
    wire = PtyWire(BAUD, emulator.receive)
    said: list[bytes] = []

    def send(data: bytes, delay_s: float) -> None:
        said.append(data)
        wire.send(data, delay_s)

    emulator.connect(BadLine("gps", twin, clock, send, wire.byte_s))
    wire.plug()
    serving = loop.create_task(emulator.serve())
    port = str(free_port())
    quiet = asyncio.subprocess.DEVNULL
    gpsd = await asyncio.create_subprocess_exec(
        "gpsd", "-N", "-n", "-b", "-S", port, wire.path, stdout=quiet, stderr=quiet, stdin=quiet
    )
    pipe = None
    try:
        await until_open(int(port))
        pipe = await asyncio.create_subprocess_exec(
            "gpspipe", "-w", f"127.0.0.1:{port}", stdout=asyncio.subprocess.PIPE, stderr=quiet, limit=1 << 20
        )
        assert pipe.stdout is not None
        yield Bench(twin, clock, pipe.stdout, wire, said)
    finally:
        for process in (pipe, gpsd):
            if process is not None and process.returncode is None:
                process.terminate()
                await process.wait()
        serving.cancel()
        await asyncio.wait({serving})
        wire.unplug()


async def until_open(port: int) -> None:
    while True:
        try:
            _, writer = await asyncio.open_connection("127.0.0.1", port)
        except OSError:
            await asyncio.sleep(0.05)
        else:
            writer.close()
            await writer.wait_closed()
            return


def run(test: Callable[[Bench], Awaitable[None]], receiver: EmulatedReceiver | None = None, **changes: Any) -> None:
    async def main() -> None:
        async with asyncio.timeout(LONGEST_S), read_by_gpsd(receiver or EmulatedReceiver(), **changes) as bench:
            await test(bench)

    asyncio.run(main())


@needs_gpsd
@pytest.mark.parametrize("rate_hz", [1.0, 5.0, 10.0])
def test_gpsd_and_we_read_the_same_place_and_mode(rate_hz: float) -> None:
    async def test(bench: Bench) -> None:
        reports = (await bench.next_fixes(6))[2:]
        ours = bench.our_epochs()
        for report in reports:
            epoch = ours[report["time"]]
            assert report["mode"] == epoch.mode == 3
            assert report["lat"] == pytest.approx(epoch.latitude_deg, abs=2e-9)
            assert report["lon"] == pytest.approx(epoch.longitude_deg, abs=2e-9)
            assert report["altMSL"] == pytest.approx(epoch.altitude_m, abs=1e-3)
            assert report["lat"] == pytest.approx(bench.twin.nominal.gps_latitude_deg, abs=1e-6)
            assert report["lon"] == pytest.approx(bench.twin.nominal.gps_longitude_deg, abs=1e-6)
            assert report["status"] == 3

    run(test, gps_rate_hz=rate_hz)


@needs_gpsd
@pytest.mark.parametrize("quality", RTK_STATUS)
def test_gpsd_understands_the_quality(quality: FixQuality) -> None:
    async def test(bench: Bench) -> None:
        (*_, report) = await bench.next_fixes(4)
        assert report["status"] == RTK_STATUS[quality]
        assert bench.our_epochs()[report["time"]].quality is quality

    run(test, gps_quality=quality)


@needs_gpsd
def test_gpsd_sees_the_fix_go_and_come_back() -> None:
    async def test(bench: Bench) -> None:
        assert [report["mode"] for report in await bench.next_fixes(3)][-1] == 3
        bench.twin.apply(bench.clock(), c.WorldGpsQuality(int(FixQuality.NONE)))
        assert [report["mode"] for report in await bench.next_fixes(4)][-1] == 1
        bench.twin.apply(bench.clock(), c.WorldGpsQuality(int(FixQuality.RTK_FLOAT)))
        assert [report["mode"] for report in await bench.next_fixes(4)][-1] == 3

    run(test)


@needs_gpsd
def test_gpsd_reads_speed_and_course() -> None:
    async def test(bench: Bench) -> None:
        await bench.next_fixes(2)

        async def drive() -> None:
            while True:
                bench.twin.apply(bench.clock(), c.WheelsDrive(0.3, 0.0))
                await asyncio.sleep(0.1)

        driving = asyncio.create_task(drive())
        try:
            (*_, report) = await bench.next_fixes(14)
        finally:
            driving.cancel()
        assert report["speed"] == pytest.approx(0.3, abs=0.05)
        assert report["track"] == pytest.approx(57.3, abs=5.0)

    run(test, gps_row_heading_rad=1.0)


@needs_gpsdecode
def test_gpsdecode_reads_the_corrections_of_our_base(tmp_path: Path) -> None:
    base = BaseStation(47.66, 9.175, 452.0, number=7)
    data = b"".join(frame for second in range(3) for frame in base.epoch(float(second)))
    done = subprocess.run(["gpsdecode", "-j"], input=data, capture_output=True, timeout=LONGEST_S, check=True)
    messages = [json.loads(line) for line in done.stdout.splitlines() if b'"RTCM3"' in line]
    assert [message["type"] for message in messages] == [1005, 1074, 1084] * 3
    assert [messages[0][axis] for axis in "xyz"] == pytest.approx(base.earth_centred_m, abs=1e-3)
    assert messages[0]["station_id"] == 7

"""``sprayer gps read`` on logs and on ports."""

from __future__ import annotations

import asyncio
import json
import os
import signal
import sys
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

import pytest

from drivers.emulation.bad_line import BadLine
from drivers.emulation.wire import PtyWire
from drivers.errors import DeviceMissing
from drivers.gps.emulator import GpsEmulator
from drivers.gps.sentence_text import sentence
from drivers.twin import Twin
from robot.commands.gps import app
from robot.errors import FileError
from tests.drivers.twin import rig

SHARED = Path(os.environ.get("SPRAYER_SHARED", Path(__file__).parents[3] / "shared"))
LOGS = sorted((SHARED / "data" / "nmea").glob("*.log"))
needs_logs = pytest.mark.skipif(not LOGS, reason=f"no receiver logs at {SHARED / 'data' / 'nmea'} (SPRAYER_SHARED)")

KEYS = ["time", "latitude_deg", "longitude_deg", "altitude_m", "quality", "mode", "satellites", "hdop", "speed_m_s"]
KEYS += ["course_deg"]
QUALITIES = {"none", "single", "dgps", "rtk_float", "rtk_fixed"}
PROGRAM = (sys.executable, "-c", "from robot.commands.gps import app; app()")
BAUD = 115_200
LONGEST_S = 60.0
RMC = sentence("GNRMC,132819.60,A,4134.49795459,N,09345.03431408,W,0.148,124.888,180320,11.5985,E,D")
GGA = sentence("GNGGA,132819.60,4134.49795459,N,09345.03431408,W,2,10,0.9,278.161,M,-31.442,M,6.6,0133")


def read(capsys: pytest.CaptureFixture[str], *arguments: str) -> list[dict[str, Any]]:
    app(["read", *arguments], standalone_mode=False)
    return [json.loads(line) for line in capsys.readouterr().out.splitlines()]


def file_with(tmp_path: Path, data: bytes) -> str:
    path = tmp_path / "receiver.log"
    path.write_bytes(data)
    return str(path)


def test_an_epoch_is_a_line_with_these_keys(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (line,) = read(capsys, file_with(tmp_path, RMC + GGA))
    assert list(line) == KEYS
    assert line == {
        "time": "2020-03-18T13:28:19.600Z", "latitude_deg": 41.57496591, "longitude_deg": -93.750571901,
        "altitude_m": 278.161, "quality": "dgps", "mode": 3, "satellites": 10, "hdop": 0.9, "speed_m_s": 0.0761,
        "course_deg": 124.888,
    }  # fmt: skip


def test_what_is_not_known_is_null(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (line,) = read(capsys, file_with(tmp_path, sentence("GPRMC,,V,,,,,,,,,,N")))
    assert list(line) == KEYS
    assert {key for key, value in line.items() if value is not None} == {"quality", "mode"}
    assert (line["quality"], line["mode"]) == ("none", 1)


def test_comments_garbage_and_halves_are_passed_over(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    data = b"# a note with " + GGA + b"\x00\xff" * 40_000 + GGA[:30] + RMC + b"\n#\n" + RMC.replace(b"19.60", b"19.70")
    assert len(read(capsys, file_with(tmp_path, data))) == 1


def test_count_ends_the_reading(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = file_with(tmp_path, RMC * 50)
    assert len(read(capsys, path, "--count", "7")) == 7


@pytest.mark.parametrize(
    ("data", "found"),
    [(b"", "no valid NMEA sentence"), (os.urandom(100_000), "no valid NMEA"), (sentence("GPTXT,01,01,02,x"), "GPTXT")],
    ids=["empty", "noise", "no positions"],
)
def test_a_file_without_positions_is_an_error(tmp_path: Path, data: bytes, found: str) -> None:
    with pytest.raises(FileError, match=found):
        app(["read", file_with(tmp_path, data)], standalone_mode=False)


def test_what_is_not_there_is_an_error_of_its_kind(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError):
        app(["read", str(tmp_path / "nowhere.log")], standalone_mode=False)
    with pytest.raises(DeviceMissing, match="/dev/ttyNOWHERE"):
        app(["read", "/dev/ttyNOWHERE"], standalone_mode=False)
    with pytest.raises(IsADirectoryError):
        app(["read", str(tmp_path)], standalone_mode=False)


@needs_logs
@pytest.mark.parametrize("path", LOGS, ids=lambda path: path.stem)
def test_every_log_is_read(path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    lines = read(capsys, str(path))
    assert lines
    for line in lines:
        assert list(line) == KEYS
        assert line["quality"] in QUALITIES
        assert line["mode"] in (1, 2, 3)
        assert (line["latitude_deg"] is None) == (line["quality"] == "none") == (line["mode"] == 1)


# --- ports


def on_a_port(test: Callable[[str, Twin], Awaitable[None]], **changes: Any) -> None:
    async def main() -> None:
        loop = asyncio.get_running_loop()
        begun_s = loop.time()

        def clock() -> float:
            return loop.time() - begun_s

        twin = rig.twin(**changes)
        emulator = GpsEmulator(twin, clock)
        wire = PtyWire(BAUD, emulator.receive)
        emulator.connect(BadLine("gps", twin, clock, wire.send, wire.byte_s))
        wire.plug()
        serving = loop.create_task(emulator.serve())
        try:
            await asyncio.wait_for(test(wire.path, twin), LONGEST_S)
        finally:
            serving.cancel()
            await asyncio.wait({serving})
            wire.unplug()

    asyncio.run(main())


async def program(*arguments: str) -> asyncio.subprocess.Process:
    pipe = asyncio.subprocess.PIPE
    return await asyncio.create_subprocess_exec(*PROGRAM, "read", *arguments, stdout=pipe, stderr=pipe)


def test_a_port_is_read_for_a_number_of_epochs() -> None:
    async def test(port: str, twin: Twin) -> None:
        process = await program(port, "--count", "5")
        out, err = await process.communicate()
        assert (process.returncode, err) == (0, b"")
        lines = [json.loads(line) for line in out.splitlines()]
        assert len(lines) == 5
        for line in lines:
            assert list(line) == KEYS
            assert (line["quality"], line["mode"], line["satellites"]) == ("rtk_fixed", 3, 18)
            assert line["latitude_deg"] == pytest.approx(twin.nominal.gps_latitude_deg, abs=1e-6)
            assert line["time"].startswith("2026-06-15T10:0")

    on_a_port(test)


def test_a_port_is_read_for_a_while_at_the_receivers_rate() -> None:
    async def test(port: str, twin: Twin) -> None:
        process = await program(port, "--seconds", "3")
        out, _ = await process.communicate()
        assert process.returncode == 0
        assert 5 <= len(out.splitlines()) <= 31

    on_a_port(test, gps_rate_hz=10.0)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_the_reading_clean(number: signal.Signals) -> None:
    async def test(port: str, twin: Twin) -> None:
        process = await program(port)
        assert process.stdout is not None
        await process.stdout.readline()
        process.send_signal(number)
        _, err = await process.communicate()
        assert (process.returncode, err) == (0, b"")

    on_a_port(test)


def test_a_reader_that_has_seen_enough_ends_it_clean() -> None:
    async def test(port: str, twin: Twin) -> None:
        process = await asyncio.create_subprocess_shell(
            f"'{PROGRAM[0]}' -c '{PROGRAM[2]}' read {port} | head -1; exit ${{PIPESTATUS[0]}}",
            stdout=asyncio.subprocess.PIPE,
            stderr=asyncio.subprocess.PIPE,
            executable="/bin/bash",
        )
        out, err = await process.communicate()
        assert (process.returncode, err) == (0, b"")
        assert json.loads(out)["quality"] == "rtk_fixed"

    on_a_port(test)


def test_a_port_where_nothing_speaks_is_an_error_that_says_so() -> None:
    master, slave = os.openpty()
    try:
        with pytest.raises(DeviceMissing, match="silence"):
            app(["read", os.ttyname(slave)], standalone_mode=False)
    finally:
        os.close(master)
        os.close(slave)

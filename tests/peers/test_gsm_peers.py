"""Programs of others exchange texts with our emulated modem: gammu, and smsd of the SMS server tools."""

from __future__ import annotations

import asyncio
import shutil
import subprocess
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

import pytest

from drivers.emulation.bad_line import BadLine
from drivers.emulation.wire import PtyWire
from drivers.modem.emulator import ModemEmulator
from drivers.twin import Twin
from drivers.twin import commands as c
from tests.drivers.twin import rig

pytestmark = pytest.mark.peer

BAUD = 115_200
LONGEST_S = 120.0
WORKER, PHONE = "+4915112345678", "+491700000000"
SHORT = "STOP please [now]"
LONG = "row 7: 41 fruit, 190 ml, 3 refused; " * 10 + "done"
UCS2 = "Tank leer: 5 °C, Grüße ж 😀"

needs_gammu = pytest.mark.skipif(shutil.which("gammu") is None, reason="no gammu: apt install gammu")
needs_smsd = pytest.mark.skipif(shutil.which("smsd") is None, reason="no smsd: apt install smstools")


@dataclass
class Bench:
    twin: Twin
    port: str
    clock: Callable[[], float]

    def text(self, text: str) -> None:
        self.twin.apply(self.clock(), c.WorldText(WORKER, text))

    @property
    def outbox(self) -> list[tuple[str, str]]:
        return [(sent.number, sent.text) for sent in self.twin.outbox]


@asynccontextmanager
async def emulated() -> AsyncIterator[Bench]:
    loop = asyncio.get_running_loop()
    begun_s = loop.time()

    def clock() -> float:
        return loop.time() - begun_s

    twin = rig.twin()
    emulator = ModemEmulator(twin, clock)
    wire = PtyWire(BAUD, emulator.receive)
    emulator.connect(BadLine("modem", twin, clock, wire.send, wire.byte_s))
    wire.plug()
    serving = loop.create_task(emulator.serve())
    try:
        yield Bench(twin, wire.path, clock)
    finally:
        serving.cancel()
        with suppress(asyncio.CancelledError):
            await serving
        wire.unplug()


async def gammu(bench: Bench, folder: Path, *arguments: str) -> str:
    config = folder / "gammurc"
    config.write_text(f"[gammu]\ndevice = {bench.port}\nconnection = at115200\nsynchronizetime = no\n")
    process = await asyncio.create_subprocess_exec(
        "gammu", "-c", str(config), *arguments, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
        env={"LC_ALL": "C.UTF-8", "PATH": "/usr/bin:/bin", "HOME": str(folder)},
    )  # fmt: skip
    try:
        told, _ = await asyncio.wait_for(process.communicate(), LONGEST_S)
    finally:
        if process.returncode is None:
            process.kill()
            await process.wait()
    text = told.decode()
    assert process.returncode == 0, text
    return text


async def until(condition: Callable[[], bool], longest_s: float = LONGEST_S) -> None:
    async with asyncio.timeout(longest_s):
        while not condition():  # noqa: ASYNC110 - files that another program writes give no signal
            await asyncio.sleep(0.1)


def with_modem(test: Callable[[Bench], Awaitable[None]]) -> None:
    async def main() -> None:
        async with emulated() as bench:
            await test(bench)

    asyncio.run(main())


@needs_gammu
def test_gammu_knows_our_modem_and_its_network(tmp_path: Path) -> None:
    async def test(bench: Bench) -> None:
        told = await gammu(bench, tmp_path, "identify")
        assert "SIMCOM_SIM800L" in told
        assert "867856030000000" in told
        assert "262011234567890" in told
        told = await gammu(bench, tmp_path, "networkinfo")
        assert "home network" in told
        assert f'"{bench.twin.nominal.modem_operator}"' in told

    with_modem(test)


@needs_gammu
def test_gammu_reads_short_long_and_unicode_texts(tmp_path: Path) -> None:
    async def test(bench: Bench) -> None:
        for text in (SHORT, UCS2, LONG):
            bench.text(text)
        told = await gammu(bench, tmp_path, "getallsms")
        assert told.count(f'Remote number        : "{WORKER}"') == 5
        assert f"\n{SHORT}\n" in told
        assert f"\n{UCS2}\n" in told
        assert [f"part {number} of 3" in told for number in (1, 2, 3)] == [True] * 3
        bodies = [block.split("\n\n")[1] for block in told.split("Location ") if "Concatenated" in block]
        assert "".join(bodies).rstrip("\n") == LONG

    with_modem(test)


@needs_gammu
@pytest.mark.parametrize(
    ("text", "options"),
    [(SHORT, []), (LONG, ["-autolen", "400"]), (UCS2, ["-unicode"])],
    ids=["short", "long", "ucs2"],
)
def test_gammu_sends_a_text_through_our_modem(text: str, options: list[str], tmp_path: Path) -> None:
    async def test(bench: Bench) -> None:
        told = await gammu(bench, tmp_path, "sendsms", "TEXT", PHONE, *options, "-text", text)
        assert "message reference=1" in told
        assert bench.outbox == [(PHONE, text)]

    with_modem(test)


@needs_smsd
def test_smsd_sends_and_receives_long_and_unicode_texts(tmp_path: Path) -> None:
    for name in ("outgoing", "checked", "failed", "incoming", "sent"):
        (tmp_path / name).mkdir()

    def received() -> list[bytes]:
        files = (tmp_path / "incoming").glob("GSM1.*")
        return sorted(file.read_bytes().split(b"\n\n", 1)[1] for file in files)

    async def test(bench: Bench) -> None:
        for text in (SHORT, UCS2, LONG):
            bench.text(text)
        (tmp_path / "outgoing" / "short").write_text(f"To: {PHONE[1:]}\n\n{SHORT}")
        (tmp_path / "outgoing" / "long").write_text(f"To: {PHONE[1:]}\n\n{LONG}")
        unicode = f"To: {PHONE[1:]}\nAlphabet: UCS2\n\n".encode() + UCS2.encode("utf-16-be")
        (tmp_path / "outgoing" / "unicode").write_bytes(unicode)
        process = await asyncio.create_subprocess_exec(
            "smsd", "-c", str(_smsd_config(tmp_path, bench.port)), "-t",
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )  # fmt: skip
        try:
            await until(lambda: len(received()) == 3 and len(bench.outbox) == 3)
            await until(lambda: not bench.twin.texts(bench.clock()))  # it has deleted what it has read
        finally:
            process.terminate()
            await asyncio.wait_for(process.wait(), LONGEST_S)
        assert sorted(bench.outbox) == sorted((PHONE, text) for text in (SHORT, LONG, UCS2))
        expected = [SHORT.encode("latin-1"), LONG.encode("latin-1"), UCS2.encode("utf-16-be")]
        assert received() == sorted(expected)
        assert not list((tmp_path / "failed").iterdir())

    with_modem(test)


def _smsd_config(folder: Path, port: str) -> Path:
    config = folder / "smsd.conf"
    places = "".join(f"{name} = {folder / name}\n" for name in ("outgoing", "checked", "failed", "incoming", "sent"))
    config.write_text(
        "devices = GSM1\n" + places + f"logfile = {folder / 'smsd.log'}\ninfofile = {folder / 'working'}\n"
        f"pidfile = {folder / 'smsd.pid'}\ndelaytime = 1\nerrorsleeptime = 1\nautosplit = 3\n"
        f'[GSM1]\ninit = AT+CPMS="SM","SM","SM"\ndevice = {port}\nbaudrate = {BAUD}\nincoming = yes\n'
        "internal_combine = yes\n"
    )
    return config

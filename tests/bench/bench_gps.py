"""What reading a receiver costs: sentences, garbage, and a flood on the driver's own thread."""

from __future__ import annotations

import asyncio
import os
import subprocess
import sys
import time
import tty
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pynmea2

from drivers.gps import sentence_text as text
from drivers.gps.epochs import EpochAssembler
from drivers.gps.nmea import NmeaGps, NmeaSettings
from drivers.gps.sentence_reader import SentenceReader
from drivers.gps.values import Fix, FixQuality
from drivers.line import PortSettings
from tests.bench.lines import Say, say

HOME = Path(__file__).parents[2]
CHUNK_BYTES = 512
EPOCHS = 2000
FLOOD_BYTES_S = 1_000_000.0
NOISE_BYTES = 1024
FLOOD_S = 4.0
WIRE_BAUD = 115_200


def epoch(number: int) -> bytes:
    """A burst as a receiver of centimetres sends it (seven sentences, GSV left out)."""
    second, tenth = divmod(number, 10)
    utc = datetime(2026, 6, 15, 10, second // 60 % 60, second % 60, 100_000 * tenth, UTC)
    fix = Fix(0.0, utc, FixQuality.RTK_FIXED, 47.66, 9.175, 404.0, 0.008, 18, 0.7, 0.3, 1.0, 1.0)
    told = (text.rmc("GN", fix), text.gga("GN", fix, 1.0), text.vtg("GN", fix), text.gsa("GN", fix))
    return b"".join((*told, text.gst("GN", fix), text.hdt("GN", fix)))


def fed(data: bytes) -> tuple[float, SentenceReader, int]:
    """CPU seconds for reading ``data`` into epochs, and what was read."""
    reader, assembler = SentenceReader(1e-5, capped=False), EpochAssembler(learn=True)
    epochs = 0
    began = time.thread_time()
    for place in range(0, len(data), CHUNK_BYTES):
        for began_s, sentence in reader.feed(data[place : place + CHUNK_BYTES], 0.0):
            epochs += len(assembler.add(sentence, began_s))
    return time.thread_time() - began, reader, epochs


def throughput(line: Say) -> None:
    data = b"".join(epoch(number) for number in range(EPOCHS))
    spent_s, reader, epochs = fed(data)
    sentences = reader.statistics.sentences
    wire_s = WIRE_BAUD / 10 / (len(data) / sentences)
    line(
        "gps: NMEA into epochs",
        f"{sentences / spent_s:8.0f} sentences/s  {len(data) / spent_s / 1e6:5.2f} MB/s  {epochs} epochs  "
        f"{1e6 * spent_s / sentences:5.1f} us a sentence",
        f"wire at {WIRE_BAUD} baud: {wire_s:.0f} sentences/s",
    )
    began = time.thread_time()
    for frame in data.decode().splitlines():
        pynmea2.parse(frame, check=True)
    line("gps: of that, pynmea2 alone", f"{1e6 * (time.thread_time() - began) / sentences:8.1f} us a sentence", "")


def garbage(line: Say) -> None:
    dice = np.random.default_rng(1)
    kinds = {
        "random bytes": dice.bytes(8_000_000),
        "text without end": b"$GPGGA," + b"9" * 4_000_000,
        "dollars": b"$" * 4_000_000,
        "wrong checksums": b"".join(epoch(n) for n in range(500)).replace(b",", b";"),
    }
    for name, data in kinds.items():
        spent_s, reader, _ = fed(data)
        line(
            f"gps: garbage, {name}",
            f"{len(data) / spent_s / 1e6:8.1f} MB/s  {reader.statistics.sentences} sentences",
            "1 MB/s for 10 % of a core",
        )


def talk(descriptor: int, bytes_s: float) -> None:
    """A 10 Hz receiver on a terminal, with ``bytes_s`` of noise between its bursts, until it is ended."""
    noise = np.random.default_rng(2).bytes(1 << 20)
    begun_s, number, sent = time.monotonic(), 0, 0
    while True:
        os.write(descriptor, epoch(number))
        number += 1
        while (at_s := time.monotonic() - begun_s) < 0.1 * number:
            while sent < bytes_s * at_s:
                place = sent % ((1 << 20) - NOISE_BYTES)
                sent += os.write(descriptor, noise[place : place + NOISE_BYTES])
            time.sleep(0.001)


@dataclass(frozen=True)
class Flooded:
    """What ``FLOOD_S`` of a flood cost. ``share`` of a core by all threads of this process."""

    share: float
    fixes: int
    heard_bytes: int
    grown_bytes: int


def flooded(bytes_s: float) -> Flooded:
    """The driver on a 10 Hz receiver that another process plays, with noise between the bursts."""
    master, slave = os.openpty()
    tty.setraw(slave)
    talker = subprocess.Popen(
        [sys.executable, "-m", "tests.bench.bench_gps", str(master), str(bytes_s)], pass_fds=[master], cwd=HOME
    )
    try:
        return asyncio.run(_listen(os.ttyname(slave)))
    finally:
        talker.kill()
        talker.wait()
        os.close(master)
        os.close(slave)


def flood(line: Say) -> None:
    for name, bytes_s in (("", 0.0), (" in 1 MB/s of noise", FLOOD_BYTES_S)):
        cost = flooded(bytes_s)
        line(
            f"gps: driver, 10 Hz receiver{name}",
            f"{100.0 * cost.share:5.1f} % of a core  {cost.fixes / FLOOD_S:.1f} fixes/s  "
            f"{cost.heard_bytes / FLOOD_S / 1e6:.2f} MB/s heard  memory +{cost.grown_bytes / 1e6:.1f} MB",
            "<= 10 % of a core" if bytes_s else "",
        )


async def _listen(path: str) -> Flooded:
    loop = asyncio.get_running_loop()
    device = NmeaGps(NmeaSettings(), PortSettings(path, "gps", WIRE_BAUD, "nmea"), loop.time)
    await device.open()
    for _ in range(5):
        await device.next_fix()
    heard, memory, cpu_s, fixes = device.heard_bytes, _resident(), time.process_time(), 0
    end_s = loop.time() + FLOOD_S
    while loop.time() < end_s:
        await device.next_fix()
        fixes += 1
    share = (time.process_time() - cpu_s) / FLOOD_S
    cost = Flooded(share, fixes, device.heard_bytes - heard, _resident() - memory)
    await device.close()
    return cost


def _resident() -> int:
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


def bench(line: Say) -> None:
    throughput(line)
    garbage(line)
    flood(line)


def main() -> None:
    if len(sys.argv) > 1:
        talk(int(sys.argv[1]), float(sys.argv[2]))

    bench(say)


if __name__ == "__main__":
    main()

"""How long the all-off script takes: to start, to the first frame that shuts the valve, and to all verified off."""

from __future__ import annotations

import asyncio
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from tests.bench.lines import Say, say
from tests.e2e.alloff import SCRIPT, call, machine, until

STARTS = 40
CALLS = 5
BAUDS = (9600, 115200)


def started_ms() -> list[float]:
    """Wall time of a whole call that finds no file, milliseconds: what is left is the start."""
    times_ms = []
    for _ in range(STARTS):
        began_s = time.perf_counter()
        subprocess.run(
            [str(SCRIPT), "--if-present", "--file", os.devnull + "/none"], check=True, stderr=subprocess.DEVNULL
        )
        times_ms.append(1e3 * (time.perf_counter() - began_s))
    return times_ms


async def switched_off_ms(baud: int, folder: Path) -> tuple[float, float]:
    """From the call to the shut valve, and to the end with everything read back; worst of a few, milliseconds."""
    shut_ms, ended_ms = [], []
    for _ in range(CALLS):
        async with machine("waveshare-8", baud=baud) as m:
            file = m.write_file(folder / "alloff.conf")
            m.switch_all_on()
            await until(lambda m=m: m.valve_open)  # type: ignore[misc]
            began_s = time.perf_counter()
            calling = asyncio.create_task(call("--file", str(file)))
            while m.valve_open and not calling.done():  # noqa: ASYNC110  the machine is watched, as by a scope
                await asyncio.sleep(0.001)
            shut_ms.append(1e3 * (time.perf_counter() - began_s))
            called = await calling
            ended_ms.append(1e3 * (time.perf_counter() - began_s))
            assert (called.code, m.on) == (0, []), called.said
    return max(shut_ms), max(ended_ms)


def bench(say: Say) -> None:
    """Print the figures."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    times_ms = started_ms()
    more = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu_ms = 1e3 * (more.ru_utime + more.ru_stime - used.ru_utime - used.ru_stime) / STARTS
    median_ms, worst_ms = statistics.median(times_ms), max(times_ms)
    figures = f"median {median_ms:.0f} ms   worst {worst_ms:.0f} ms   CPU {cpu_ms:.0f} ms   n {STARTS}"
    say("sprayer-alloff: start", figures, "< 50 ms")
    with tempfile.TemporaryDirectory() as folder:
        for baud in BAUDS:
            shut_ms, ended_ms = asyncio.run(switched_off_ms(baud, Path(folder)))
            figures = f"worst {shut_ms:.0f} ms to the shut valve, {ended_ms:.0f} ms to all verified"
            say(f"sprayer-alloff: everything on, {baud} baud", figures)


if __name__ == "__main__":
    sys.stdout.write("all-off script\n")
    bench(say)

"""``sprayer gps``: what a receiver says, or said."""

from __future__ import annotations

import asyncio
import json
import os
import stat
import sys
from datetime import UTC
from pathlib import Path
from typing import Annotated

import typer

from drivers.gps.epochs import Epoch
from drivers.gps.nmea import NmeaGps, NmeaSettings
from drivers.gps.raw_log import RawLog
from drivers.line import PortSettings
from robot.errors import FileError
from robot.runtime.signals import StopSignals

app = typer.Typer(help="Look at the GPS receiver.", no_args_is_help=True)


@app.callback()
def gps() -> None:
    """Look at the GPS receiver."""


@app.command()
def read(
    source: Annotated[Path, typer.Argument(metavar="PORT|FILE", help="A serial port, or a log of a receiver's bytes.")],
    baud: Annotated[int, typer.Option("--baud", min=1200, max=4_500_000, help="Of the port.")] = 115_200,
    count: Annotated[int | None, typer.Option("--count", min=1, metavar="N", help="End after N epochs.")] = None,
    seconds: Annotated[
        float | None, typer.Option("--seconds", min=0.1, metavar="S", help="End after S seconds (of a port).")
    ] = None,
) -> None:
    """Print a line of JSON for each epoch."""
    try:
        if _is_file(source):
            _read_file(source, count)
        else:
            signals = StopSignals().install()
            asyncio.run(_read_port(PortSettings(str(source), "gps", baud, "nmea"), count, seconds, signals))
        sys.stdout.flush()
    except BrokenPipeError:  # whoever read the lines has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def epoch_line(epoch: Epoch) -> str:
    """An epoch as JSON. ``mode`` is gpsd's: 1 no fix, 2 2-D, 3 3-D; what is unknown is null."""
    utc = None if epoch.utc is None else epoch.utc.astimezone(UTC).replace(tzinfo=None)
    return json.dumps(
        {
            "time": None if utc is None else f"{utc.isoformat(timespec='milliseconds')}Z",
            "latitude_deg": _rounded(epoch.latitude_deg, 9),
            "longitude_deg": _rounded(epoch.longitude_deg, 9),
            "altitude_m": _rounded(epoch.altitude_m, 4),
            "quality": epoch.quality.name.lower(),
            "mode": epoch.mode,
            "satellites": epoch.satellites,
            "hdop": _rounded(epoch.hdop, 2),
            "speed_m_s": _rounded(epoch.speed_m_s, 4),
            "course_deg": _rounded(epoch.course_deg, 3),
        }
    )


def _rounded(value: float | None, digits: int) -> float | None:
    return None if value is None else round(value, digits)


def _say(epoch: Epoch) -> None:
    sys.stdout.write(epoch_line(epoch) + "\n")


def _is_file(source: Path) -> bool:
    """What is not there is a port that is missing when it is named like one."""
    try:
        return not stat.S_ISCHR(source.stat().st_mode)
    except FileNotFoundError:
        return not source.is_absolute() or source.parts[1:2] != ("dev",)


def _read_file(path: Path, count: int | None) -> None:
    told = 0
    with path.open("rb") as stream:
        log = RawLog(stream)
        for epoch in log.epochs():
            _say(epoch)
            told += 1
            if told == count:
                return
    if told == 0:
        found = " ".join(sorted(log.statistics.kinds)) or "no valid NMEA sentence"
        raise FileError(
            f"{path}: expected sentences with positions (GGA, RMC), found {found}; give a log of a receiver's output"
        )


async def _read_port(port: PortSettings, count: int | None, seconds: float | None, signals: StopSignals) -> None:
    loop = asyncio.get_running_loop()
    device = NmeaGps(NmeaSettings(), port, loop.time)
    stopped = asyncio.create_task(signals.wait())
    telling = asyncio.create_task(_tell(device, count))
    try:
        await asyncio.wait({stopped, telling}, timeout=seconds, return_when=asyncio.FIRST_COMPLETED)
        if telling.done():
            telling.result()
    finally:
        stopped.cancel()
        telling.cancel()
        await asyncio.wait({stopped, telling})
        await device.close()


async def _tell(device: NmeaGps, count: int | None) -> None:
    await device.open()
    told = 0
    while told != count:
        _say(await device.next_epoch())
        sys.stdout.flush()
        told += 1

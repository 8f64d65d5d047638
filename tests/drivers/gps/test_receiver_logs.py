"""Logs of 53 receivers, and what gpsd made of them: same place, same mode, wherever both have a fix."""

from __future__ import annotations

import json
import os
from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from drivers.gps.epochs import Epoch
from drivers.gps.raw_log import RawLog
from drivers.gps.values import FixQuality

SHARED = Path(os.environ.get("SPRAYER_SHARED", Path(__file__).parents[4] / "shared"))
FOLDER = SHARED / "data" / "nmea"
LOGS = sorted(FOLDER.glob("*.log"))
needs_logs = pytest.mark.skipif(not LOGS, reason=f"no receiver logs at {FOLDER} (SPRAYER_SHARED)")

PLACE_DEG = 1e-7  # 1 cm; gpsd writes nine decimals
WITHOUT_A_FIX_AND_TIME = {"eXplorist110.log", "ublox-lea-5q.log"}
CLOCK_WENT_BACK = {"humminbird-M37.log"}  # it tells some times twice
GPSD_IS_1024_WEEKS_AHEAD = {"neo-m8n.log"}  # compared by the time of the day


@dataclass(frozen=True)
class Compared:
    epochs: int
    both: int
    ours_alone: int
    theirs_alone: int
    differences: list[str]


def epochs_of(path: Path) -> list[Epoch]:
    with path.open("rb") as stream:
        return list(RawLog(stream).epochs())


def reports_of(path: Path) -> dict[str, list[dict[str, Any]]]:
    """gpsd's reports with a fix and a time, by time. It may report several times in an epoch."""
    found: dict[str, list[dict[str, Any]]] = defaultdict(list)
    for line in path.with_suffix(".log.chk").read_text(encoding="latin-1").splitlines():
        if line.startswith('{"class":"TPV"'):
            report = json.loads(line)
            if report["mode"] >= 2 and "time" in report:
                found[key_of(path, report["time"])].append(report)
    return found


def key_of(path: Path, time: str) -> str:
    return time.partition("T")[2] if path.name in GPSD_IS_1024_WEEKS_AHEAD else time


def compare(path: Path) -> Compared:
    epochs, reports = epochs_of(path), reports_of(path)
    met: set[str] = set()
    differences = []
    both = ours_alone = 0
    for epoch in epochs:
        if epoch.utc is None:
            continue
        key = key_of(path, epoch.utc.isoformat(timespec="milliseconds").replace("+00:00", "Z"))
        met.add(key)
        if epoch.quality is FixQuality.NONE:
            differences += [f"{key}: a fix for gpsd alone"] if key in reports else []
        elif key not in reports:
            ours_alone += 1
        else:
            both += 1
            differences += difference(path, key, epoch, reports[key])
    return Compared(len(epochs), both, ours_alone, len(reports.keys() - met), differences)


def difference(path: Path, key: str, epoch: Epoch, reports: list[dict[str, Any]]) -> list[str]:
    """Against gpsd's last word on the epoch, or, where the receiver's clock went back, against what it said there."""
    last = reports[-1]
    if path.name in CLOCK_WENT_BACK:
        last = min(reports, key=lambda report: away_deg(epoch, report))
    told = []
    if away_deg(epoch, last) > PLACE_DEG:
        told.append(f"{key}: {away_deg(epoch, last):.9f} deg apart")
    if epoch.mode != last["mode"]:
        told.append(f"{key}: mode {epoch.mode}, gpsd {last['mode']}")
    return told


def away_deg(epoch: Epoch, report: dict[str, Any]) -> float:
    assert epoch.latitude_deg is not None
    assert epoch.longitude_deg is not None
    return max(abs(epoch.latitude_deg - report["lat"]), abs(epoch.longitude_deg - report["lon"]))


@needs_logs
def test_all_the_logs_are_there() -> None:
    assert len(LOGS) == 53


@needs_logs
@pytest.mark.parametrize("path", LOGS, ids=lambda path: path.stem)
def test_the_epochs_of_a_log_are_those_of_gpsd(path: Path) -> None:
    compared = compare(path)
    assert compared.differences == []
    assert compared.theirs_alone == 0
    assert compared.ours_alone <= 3, "gpsd tells nothing of an epoch that the end of the log cuts off"
    assert (compared.both > 0) == (path.name not in WITHOUT_A_FIX_AND_TIME)


@needs_logs
def test_more_than_a_thousand_epochs_were_compared() -> None:
    assert sum(compare(path).both for path in LOGS) >= 1100


@needs_logs
@pytest.mark.parametrize("path", LOGS[::6], ids=lambda path: path.stem)
def test_a_log_may_be_cut_anywhere(path: Path, tmp_path: Path) -> None:
    data = path.read_bytes()
    part = tmp_path / "part.log"
    whole = epochs_of(path)
    for share in (0.31, 0.5, 0.77):
        part.write_bytes(data[: int(share * len(data))])
        assert len(epochs_of(part)) <= len(whole)

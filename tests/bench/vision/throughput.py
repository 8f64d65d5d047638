"""``sprayer detect`` on a folder of pairs: pairs a second, and the memory of all its processes."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

from tests.bench.vision.labelled import spread

PAIRS = 100
_SPEED = re.compile(r"([0-9.]+) pairs per second")
_LOOK_S = 0.1
_MB = 1e6 / 1024.0  # /proc counts in KiB


@dataclass(frozen=True, slots=True)
class Throughput:
    """Peaks over looks every 0.1 s. ``pss_mb`` counts a page that processes share once, ``rss_mb`` once for each."""

    pairs: int
    cores: int
    processes: int
    pairs_per_s: float
    wall_s: float
    cores_busy: float
    pss_mb: float
    rss_mb: float


def detect_folder(folder: Path, count: int = PAIRS) -> Throughput:
    """Run the command on ``count`` pairs of a split of the rendered greenhouse.

    ``RuntimeError`` with what it said when it fails.
    """
    stems = spread(tuple(sorted(path.name[: -len("_left.jpg")] for path in folder.glob("*_left.jpg"))), count)
    with tempfile.TemporaryDirectory() as place:
        pairs = Path(place) / "pairs"
        pairs.mkdir()
        for stem in stems:
            for end in ("_left.jpg", "_right.jpg", ".json"):
                (pairs / f"{stem}{end}").symlink_to((folder / f"{stem}{end}").resolve())
        call = "import sys; from robot.cli import main; sys.argv[0] = 'sprayer'; main()"
        command = [sys.executable, "-c", call, "detect", str(pairs), "--out", f"{place}/fruit.jsonl"]
        return _watched([*command, "--calibration", str(folder.parent)], len(stems))


def _watched(command: list[str], pairs: int) -> Throughput:
    before = os.times()
    began_s = time.monotonic()
    pss_kib = rss_kib = processes = 0
    with tempfile.TemporaryFile("w+") as said:
        with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=said) as running:
            while running.poll() is None:
                family = _family(running.pid)
                processes = max(processes, len(family))
                rss_kib = max(rss_kib, sum(_kib(f"/proc/{pid}/status", "VmRSS") for pid in family))
                pss_kib = max(pss_kib, sum(_kib(f"/proc/{pid}/smaps_rollup", "Pss") for pid in family))
                time.sleep(_LOOK_S)
        wall_s = time.monotonic() - began_s
        said.seek(0)
        words = said.read()
    speed = _SPEED.search(words)
    if running.returncode != 0 or speed is None:
        raise RuntimeError(f"sprayer detect ended with {running.returncode}: {words.strip()[-2000:]}")
    after = os.times()
    busy_s = after.children_user + after.children_system - before.children_user - before.children_system
    return Throughput(
        pairs=pairs,
        cores=len(os.sched_getaffinity(0)),
        processes=processes,
        pairs_per_s=float(speed[1]),
        wall_s=wall_s,
        cores_busy=busy_s / wall_s,
        pss_mb=pss_kib / _MB,
        rss_mb=rss_kib / _MB,
    )


def _family(pid: int) -> list[int]:
    """A process and all that descend from it."""
    out = [pid]
    for one in out:
        try:
            listed = Path(f"/proc/{one}/task/{one}/children").read_text(encoding="ascii")
        except OSError:
            continue  # it has ended
        out += [int(child) for child in listed.split()]
    return out


def _kib(path: str, key: str) -> int:
    """A figure of a process, 0 when it has ended."""
    try:
        lines = Path(path).read_text(encoding="ascii", errors="replace").splitlines()
    except OSError:
        return 0
    return next((int(line.split()[1]) for line in lines if line.startswith(f"{key}:")), 0)

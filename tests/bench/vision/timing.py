"""CPU time a pair on one core: ``python -m tests.bench.vision.timing`` prints it as JSON.

The process pins itself to one core and allows every library one thread, so that its CPU time is that of the work alone.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from functools import partial

import cv2

from robot.vision.detector import Detector
from tests.bench.vision.contestants import CONTESTANTS, make_staged
from tests.bench.vision.datasets import greenhouse
from tests.bench.vision.labelled import StereoScene, StereoSet
from tests.bench.vision.twin_scenes import twin_rows

StagedMaker = Callable[[Callable[[str], None]], Detector]

_ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
TOTAL, REST = "total", "rest"
PAIRS, REPEATS = 12, 3


@dataclass(frozen=True, slots=True)
class StageTime:
    """``median_ms`` over pairs and repeats; ``least_ms`` the median over pairs of each pair's best."""

    stage: str
    median_ms: float
    least_ms: float


@dataclass(frozen=True, slots=True)
class PairTime:
    """One contestant on one set; ``stages`` in the order they ran, the total last."""

    contestant: str
    pictures: str
    size: str
    pairs: int
    stages: tuple[StageTime, ...]

    @property
    def total(self) -> StageTime:
        return self.stages[-1]


class _Stopwatch:
    """Milliseconds of CPU by stage of one call."""

    def __init__(self) -> None:
        self.times_ms: dict[str, float] = {}
        self._last_ms = 0.0

    def start(self) -> None:
        self.times_ms = {}
        self._last_ms = _cpu_ms()

    def over(self, stage: str) -> None:
        now_ms = _cpu_ms()
        self.times_ms[stage] = self.times_ms.get(stage, 0.0) + now_ms - self._last_ms
        self._last_ms = now_ms

    def stop(self) -> dict[str, float]:
        """All stages, what came after the last of them, and the total."""
        staged = bool(self.times_ms)
        self.over(REST)
        total = {TOTAL: sum(self.times_ms.values())}
        return {**self.times_ms, **total} if staged else total


def measure(name: str, make: StagedMaker, pictures: str, scenes: Sequence[StereoScene], repeats: int) -> PairTime:
    """``repeats`` runs of each pair after one that is not counted; ``make`` is given what to call after each stage."""
    watch = _Stopwatch()
    detector = make(watch.over)
    by_pair: list[list[dict[str, float]]] = []
    for scene in scenes:
        if not by_pair:
            detector.detect(scene.left, scene.right, scene.rig)
        runs = []
        for _ in range(repeats):
            watch.start()
            detector.detect(scene.left, scene.right, scene.rig)
            runs.append(watch.stop())
        by_pair.append(runs)
    stages = [stage for stage in _in_order(by_pair) if stage != TOTAL] + [TOTAL]
    times = tuple(
        StageTime(
            stage,
            statistics.median(run.get(stage, 0.0) for runs in by_pair for run in runs),
            statistics.median(min(run.get(stage, 0.0) for run in runs) for runs in by_pair),
        )
        for stage in stages
    )
    width, height = scenes[0].rig.image_size
    return PairTime(name, pictures, f"{width}x{height}", len(scenes), times)


def in_a_process(pairs: int = PAIRS, repeats: int = REPEATS, *, twin_only: bool = False) -> tuple[PairTime, ...]:
    """``main`` in a process of its own. ``RuntimeError`` with its last words when it fails."""
    command = [sys.executable, "-m", "tests.bench.vision.timing", "--pairs", str(pairs), "--repeats", str(repeats)]
    command += ["--twin-only"] if twin_only else []
    done = subprocess.run(command, env={**os.environ, **_ONE_THREAD}, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise RuntimeError(f"{' '.join(command)} failed: {done.stderr.strip()[-2000:]}")
    return tuple(
        PairTime(**{**row, "stages": tuple(StageTime(**stage) for stage in row["stages"])})
        for row in json.loads(done.stdout)
    )


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.bench.vision.timing", description=__doc__)
    parser.add_argument("--pairs", type=int, default=PAIRS)
    parser.add_argument("--repeats", type=int, default=REPEATS)
    parser.add_argument("--twin-only", action="store_true", help="leave the rendered greenhouse out")
    options = parser.parse_args(arguments)
    os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    cv2.setNumThreads(1)
    rows = []
    for pictures in _sets(options.twin_only):
        scenes = [pictures.load(name) for name in pictures.first(options.pairs).names]
        for contestant in CONTESTANTS:
            make = partial(make_staged, contestant.key)
            rows.append(measure(contestant.key, make, pictures.title, scenes, options.repeats))
    json.dump([asdict(row) for row in rows], sys.stdout, indent=1)
    return 0


def _sets(twin_only: bool) -> list[StereoSet]:
    rendered = None if twin_only else greenhouse("dev")
    return [*([rendered] if rendered is not None else []), twin_rows("640"), twin_rows("1280")]


def _in_order(by_pair: Sequence[Sequence[dict[str, float]]]) -> list[str]:
    return list(dict.fromkeys(stage for runs in by_pair for run in runs for stage in run))


def _cpu_ms() -> float:
    return 1e3 * time.process_time()


if __name__ == "__main__":
    sys.exit(main())

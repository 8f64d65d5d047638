"""Vision, measured: ``python -m tests.bench.vision --out out/bench-vision`` writes index.html and bench.json there."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path

import cv2

from tests.bench.vision import timing
from tests.bench.vision.compare import differences, read_numbers
from tests.bench.vision.datasets import ABSENT, GREENHOUSE, PHOTOS, greenhouse, photographs
from tests.bench.vision.goals import goal_rows
from tests.bench.vision.page import render
from tests.bench.vision.results import Results, Tell, look_at_photos, look_at_scenes, numbers
from tests.bench.vision.throughput import detect_folder
from tests.bench.vision.twin_scenes import SINGLE_DISTANCES_M, SINGLES, twin_rows, twin_singles

_QUICK = 3


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.bench.vision", description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("out/bench-vision"), help="folder for the page and bench.json")
    parser.add_argument("--scenes", type=int, metavar="N", help="at most N scenes or photographs of each set")
    parser.add_argument("--quick", action="store_true", help=f"{_QUICK} scenes of each set, no speed of sprayer detect")
    parser.add_argument("--twin-only", action="store_true", help="leave the sets on disk out")
    parser.add_argument("--against", type=Path, metavar="FILE", help="print what differs from this earlier bench.json")
    options = parser.parse_args(arguments)
    try:
        before = None if options.against is None else read_numbers(options.against)
    except ValueError as error:
        parser.error(str(error))
    if options.scenes is not None and options.scenes < 1:
        parser.error(f"--scenes: expected 1 or more, found {options.scenes}")
    count = _QUICK if options.quick else options.scenes
    results = measure(count, quick=options.quick, twin_only=options.twin_only, tell=_say)
    rows = goal_rows(results)
    for row in rows:
        _say(f"{row.quantity}: {row.fruit} (paper {row.paper}, goal {row.goal}): {row.verdict}")
    now = {**numbers(results), "goals": {row.quantity: dict(enumerate(row.measured)) for row in rows}}
    when = f"{datetime.now(UTC):%Y-%m-%d %H:%M} UTC" + (f", at most {count} pictures of each set" if count else "")
    options.out.mkdir(parents=True, exist_ok=True)
    page, record = options.out / "index.html", options.out / "bench.json"
    page.write_text(render(results, when), encoding="utf-8")
    record.write_text(json.dumps(now, indent=1) + "\n", encoding="utf-8")
    _say(f"written: {page} and {record}")
    if before is not None:
        changed = differences(before, json.loads(record.read_text(encoding="utf-8")))
        _say(f"against {options.against}: {len(changed)} numbers differ")
        for difference in changed:
            _say(f"  {difference}")
    return 0


def measure(count: int | None, *, quick: bool, twin_only: bool, tell: Tell) -> Results:
    """Everything, or ``count`` scenes and photographs of each set."""
    cv2.setNumThreads(1)
    rendered = None if twin_only else greenhouse("dev")
    photos = None if twin_only else photographs("val")
    absent = tuple(_absences(rendered is None, photos is None, twin_only=twin_only))
    for text in absent:
        tell(text)
    return Results(
        rendered=None if rendered is None else look_at_scenes(rendered.first(count), tell),
        photos=None if photos is None else look_at_photos(photos.first(count), tell),
        rows=look_at_scenes(twin_rows().first(count), tell),
        singles={
            distance_m: look_at_scenes(twin_singles(distance_m, min(SINGLES, count or SINGLES)), tell)
            for distance_m in SINGLE_DISTANCES_M
        },
        times=timing.in_a_process(*((2, 1) if quick else (timing.PAIRS, timing.REPEATS)), twin_only=twin_only),
        throughput=detect_folder(GREENHOUSE / "train") if rendered is not None and not quick else None,
        absent=absent,
    )


def _absences(no_scenes: bool, no_photos: bool, *, twin_only: bool) -> list[str]:
    if twin_only:
        return ["The twin alone, as asked: the rendered greenhouse and the photographs were left out."]
    return [
        f"The {name} were {ABSENT.format(place)}. The rest goes on without them."
        for name, place, missing in (
            ("rendered scenes", GREENHOUSE / "dev", no_scenes),
            ("photographs", PHOTOS, no_photos),
        )
        if missing
    ]


def _say(text: str) -> None:
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    sys.exit(main())

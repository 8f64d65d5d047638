"""Finds the rivals' values on the train splits: ``python -m tests.bench.vision.tune_rivals``.

Random search, then random steps from the best, for the best F1: of recognition and precision in stereo scenes, of
recall and precision in photographs. Values that reach less than half of the best on the first fifth of the pictures are
given up there. The splits that the bench reports on are not opened. Writes rival_values.json.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from typing import Any

import cv2
import numpy as np

from tests.bench.vision.datasets import ABSENT, GREENHOUSE, PHOTOS, greenhouse, photographs
from tests.bench.vision.labelled import PhotoSet, StereoSet
from tests.bench.vision.photo_scoring import judge_photo, photo_score
from tests.bench.vision.rivals import TUNED, ExcessGreenValues, HoughValues, Rival, RivalValues, tuned
from tests.bench.vision.scoring import judge, together

SCENES, PHOTOGRAPHS, FIRST_LOOK, SEED = 25, 50, 6, 5
Score = Callable[[RivalValues, int | None], float]  # on so many pictures, None: all


def random_hough(dice: np.random.Generator) -> HoughValues:
    return HoughValues(
        channel=("grey", "red")[int(dice.integers(2))],
        width_px=int(dice.choice([200, 280, 400])),
        blur_px=int(dice.choice([3, 5, 7, 9])),
        dp=float(dice.choice([1.0, 1.5, 2.0])),
        min_distance=_log(dice, 0.02, 0.15),
        edge=_log(dice, 20.0, 200.0),
        votes=_log(dice, 12.0, 70.0),
        min_radius=_log(dice, 0.015, 0.06),
        max_radius=_log(dice, 0.065, 0.25),
        row_tolerance=_log(dice, 0.002, 0.02),
    )


def random_excess_green(dice: np.random.Generator) -> ExcessGreenValues:
    high = float(dice.uniform(-0.6, 0.4))
    return ExcessGreenValues(
        low=high - _log(dice, 0.2, 2.0),
        high=high,
        min_code=_log(dice, 1.0, 40.0),
        open_size=float(dice.uniform(0.0, 0.03)),
        close_size=float(dice.uniform(0.0, 0.03)),
        min_radius=_log(dice, 0.015, 0.05),
        max_radius=_log(dice, 0.12, 0.35),
        min_circularity=float(dice.uniform(0.2, 0.85)),
        enclosing=bool(dice.integers(2)),
        row_tolerance=_log(dice, 0.002, 0.03),
    )


DRAWS: dict[str, Callable[[np.random.Generator], RivalValues]] = {
    "hough": random_hough,
    "excess green": random_excess_green,
}


def stepped(values: RivalValues, dice: np.random.Generator) -> RivalValues:
    """One or two of the numbers changed by up to a quarter."""
    changed: dict[str, float] = {}
    numbers = [key for key, value in asdict(values).items() if isinstance(value, float)]
    for key in dice.choice(numbers, int(dice.integers(1, 3)), replace=False):
        value = float(getattr(values, key))
        changed[str(key)] = value * float(dice.uniform(0.75, 1.3)) + float(dice.normal(0.0, 1e-3))
    if isinstance(values, HoughValues):
        changed["dp"] = max(1.0, changed.get("dp", values.dp))
    return replace(values, **changed)  # type: ignore[arg-type]


def best(draw: Callable[[np.random.Generator], RivalValues], score: Score, draws: int) -> tuple[RivalValues, float]:
    """The best of ``draws`` random values and a third as many steps from the best of them."""
    dice = np.random.default_rng(SEED)
    champion, record = draw(dice), 0.0
    for number in range(draws + draws // 3):
        challenger = draw(dice) if number < draws else stepped(champion, dice)
        if score(challenger, FIRST_LOOK) < 0.5 * record:
            continue
        reached = score(challenger, None)
        if reached > record:
            champion, record = challenger, reached
    return champion, record


def scenes_score(pictures: StereoSet) -> Score:
    scenes = [pictures.load(name) for name in pictures.names]

    def score(values: RivalValues, count: int | None) -> float:
        rival = Rival(values, values)
        judged = together(judge(s.facts, s.fruits, rival.detect(s.left, s.right, s.rig)) for s in scenes[:count])
        recognised = sum(sighting.found is not None for sighting in judged.sightings)
        return _f1(recognised / max(1, len(judged.sightings)), judged.precision or 0.0)

    return score


def photos_score(pictures: PhotoSet) -> Score:
    photos = [pictures.load(name) for name in pictures.names]

    def score(values: RivalValues, count: int | None) -> float:
        return photo_score([judge_photo(photo, values.circles(photo.image)) for photo in photos[:count]]).f1

    return score


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.bench.vision.tune_rivals", description=__doc__)
    parser.add_argument("--draws", type=int, default=150, help="random values tried for each rival and set")
    parser.add_argument("--rival", choices=DRAWS, help="this rival alone; the other's values stay")
    parser.add_argument("--pictures", choices=("scenes", "photos"), help="these pictures alone")
    options = parser.parse_args(arguments)
    scenes, photos = greenhouse("train"), photographs("train")
    if scenes is None or photos is None:
        missing = GREENHOUSE / "train" if scenes is None else PHOTOS
        sys.stderr.write(f"the train split was {ABSENT.format(missing)}\n")
        return 1
    cv2.setNumThreads(1)
    found = dict(tuned()) if TUNED.exists() else {}
    for kind in ("scenes", "photos") if options.pictures is None else (options.pictures,):
        some: StereoSet | PhotoSet = scenes.first(SCENES) if kind == "scenes" else photos.first(PHOTOGRAPHS)
        score = scenes_score(some) if isinstance(some, StereoSet) else photos_score(some)
        for rival in DRAWS if options.rival is None else (options.rival,):
            values, f1 = best(DRAWS[rival], score, options.draws)
            how = f"{options.draws} random values and {options.draws // 3} steps on {len(some.names)} pictures"
            entry = {"values": _rounded(asdict(values)), "train_f1": round(f1, 3), "how": how}
            found[rival] = {**found.get(rival, {}), kind: entry}
            TUNED.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
            sys.stdout.write(f"{rival}, {kind}: F1 {f1:.3f} with {values}\n")
            sys.stdout.flush()
    return 0


def _log(dice: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(dice.uniform(np.log(low), np.log(high))))


def _f1(recall: float, precision: float) -> float:
    return 2.0 * recall * precision / max(1e-9, recall + precision)


def _rounded(values: dict[str, Any]) -> dict[str, Any]:
    return {key: float(f"{value:.4g}") if isinstance(value, float) else value for key, value in values.items()}


if __name__ == "__main__":
    sys.exit(main())

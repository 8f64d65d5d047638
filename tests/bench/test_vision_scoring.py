"""The bench's rules: on fruit made up for it, and beside the scorers that came with the pictures."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from robot.vision.values import Circle, Fruit, Ripeness
from tests.bench.vision.datasets import ABSENT, PHOTOS, SHARED, greenhouse, photographs
from tests.bench.vision.groups import GROUPINGS, grouped
from tests.bench.vision.labelled import Photo, SceneFacts, TrueFruit
from tests.bench.vision.photo_scoring import iou, judge_photo, photo_score, recall_by_group
from tests.bench.vision.plots import wilson
from tests.bench.vision.scoring import judge, statistics_of, together

SCENE = SceneFacts("made_up", 12, False, "clear", "ideal", 15.0)
SCENE_SCORER, PHOTO_SCORER = (SHARED / "bin" / f"score_{name}.py" for name in ("greenhouse", "photos"))


def true_fruit(x_m: float, *, visible: float = 1.0, ripeness: str = "red", diameter_m: float = 0.08) -> TrueFruit:
    return TrueFruit(1, np.array([x_m, 0.0, 0.6]), diameter_m, ripeness, visible, (320.0, 240.0, 30.0), False)


def found_fruit(centre_m: Any, diameter_m: float = 0.08, covariance_m2: Any = None) -> Fruit:
    circle = Circle(320.0, 240.0, 30.0, Ripeness.RED, 0.9)
    covariance = np.eye(3) * 1e-6 if covariance_m2 is None else covariance_m2
    sizes = diameter_m, 0.001
    return Fruit(
        np.asarray(centre_m, dtype=float), covariance, *sizes, Ripeness.RED, 1.0, 0.9, 1.0, True, circle, circle
    )


def test_a_fruit_counts_once_and_within_half_its_diameter() -> None:
    truths = [true_fruit(0.0), true_fruit(0.3)]
    near, nearer, beyond = (found_fruit([x_m, 0.0, 0.6]) for x_m in (0.02, 0.01, 0.3405))
    judged = judge(SCENE, truths, [near, nearer, beyond])
    assert [sighting.found for sighting in judged.sightings] == [nearer, None]
    assert [detection.real for detection in judged.detections] == [False, True, False]
    assert judged.precision == pytest.approx(1 / 3)


def test_a_half_hidden_fruit_is_no_false_alarm_and_no_miss() -> None:
    truths = [true_fruit(0.0, visible=0.59), true_fruit(0.3, visible=0.6)]
    judged = judge(SCENE, truths, [found_fruit([0.0, 0.0, 0.6])])
    assert [sighting.truth.visible_fraction for sighting in judged.sightings] == [0.6]
    assert judged.precision == 1.0
    assert statistics_of(judged.sightings).recognition == 0.0


def test_eligible_fruit_are_matched_before_hidden_ones() -> None:
    truths = [true_fruit(0.0, visible=0.3), true_fruit(0.03)]
    judged = judge(SCENE, truths, [found_fruit([0.001, 0.0, 0.6])])
    assert judged.sightings[0].found is not None


def test_errors_are_of_the_recognised_with_their_signs() -> None:
    judged = judge(SCENE, [true_fruit(0.0)], [found_fruit([0.003, 0.0, 0.596], 0.076)])
    figures = statistics_of(judged.sightings)
    assert figures.error_median_mm == pytest.approx(5.0)
    assert figures.depth_bias_mm == pytest.approx(-4.0)
    assert figures.diameter_bias_percent == pytest.approx(-5.0)


def test_honest_covariances_hold_95_per_cent_of_their_errors() -> None:
    dice = np.random.default_rng(3)
    root = np.array([[1.0, 0.0, 0.0], [0.3, 0.8, 0.0], [0.5, -0.2, 3.0]]) * 1e-3
    errors = dice.standard_normal((4000, 3)) @ root.T
    parts = [
        judge(SCENE, [true_fruit(0.0)], [found_fruit(np.array([0.0, 0.0, 0.6]) + error, covariance_m2=root @ root.T)])
        for error in errors
    ]
    assert statistics_of(together(parts).sightings).in_two_sigma == pytest.approx(0.954, abs=0.01)
    too_sure = [
        judge(SCENE, [true_fruit(0.0)], [found_fruit(np.array([0, 0, 0.6]) + e, covariance_m2=root @ root.T / 4)])
        for e in errors[:500]
    ]
    assert (statistics_of(together(too_sure).sightings).in_two_sigma or 0.0) < 0.6


def test_detections_are_grouped_by_what_they_say_of_themselves() -> None:
    by_size = next(grouping for grouping in GROUPINGS if grouping.key == "size")
    judged = judge(
        SCENE,
        [true_fruit(0.0, diameter_m=0.06), true_fruit(0.3, diameter_m=0.1)],
        [found_fruit([0.0, 0.0, 0.6], 0.062), found_fruit([0.3, 0.0, 0.6], 0.08), found_fruit([0.6, 0.0, 0.6], 0.1)],
    )
    small, large = grouped(judged, by_size)
    assert (small.name, small.detections, small.precision) == ("5-7 cm", 1, 1.0)
    assert (large.name, large.detections, large.precision) == ("9-12 cm", 1, 0.0)
    assert large.statistics.recognition == 1.0


def test_wilson_intervals_are_those_of_the_books() -> None:
    assert wilson(5, 10) == pytest.approx((0.2366, 0.7634), abs=1e-4)
    assert wilson(0, 10) == pytest.approx((0.0, 0.2775), abs=1e-4)
    assert wilson(0, 0) == (0.0, 1.0)


def test_a_box_is_hit_by_one_circle_and_small_boxes_do_not_count() -> None:
    photo = Photo("p", np.zeros((200, 300, 3), np.uint8), np.array([[50, 50, 110, 110], [200, 100, 230, 130]], float))
    sure, second = Circle(80, 80, 30, Ripeness.RED, 0.9), Circle(80, 80, 29, Ripeness.RED, 0.8)
    on_small, tiny, alarm = (
        Circle(215, 115, 17, Ripeness.RED, 0.7),
        Circle(20, 20, 15, Ripeness.RED, 0.6),
        Circle(250, 50, 30, Ripeness.RED, 0.5),
    )
    judged = judge_photo(photo, [tiny, alarm, on_small, second, sure])
    assert [fate for _, fate in judged.circles] == ["hit", "false alarm", "ignored", "ignored", "false alarm"]
    score = photo_score([judged])
    assert (score.boxes, score.hits, score.counted_circles) == (1, 1, 3)
    assert score.ap50 == pytest.approx(1.0)
    assert iou((0.0, 0.0, 2.0, 1.0), (1.0, 0.0, 3.0, 1.0)) == pytest.approx(1 / 3)


def shaken(truth: TrueFruit, dice: np.random.Generator) -> Fruit:
    """A detection of a fruit that is off by up to about three quarters of its diameter."""
    away = dice.normal(size=3)
    away *= dice.uniform(0.0, 0.75) * truth.diameter_m / np.linalg.norm(away)
    return found_fruit(truth.centre_m + away, truth.diameter_m * dice.uniform(0.8, 1.2))


@pytest.mark.skipif(greenhouse("dev") is None or not SCENE_SCORER.is_file(), reason=ABSENT.format(SCENE_SCORER))
@pytest.mark.parametrize("kinds", [None, ("red", "turning")])
def test_scenes_score_the_same_as_with_the_scorer_beside_them(tmp_path: Path, kinds: tuple[str, ...] | None) -> None:
    pictures = greenhouse("dev")
    assert pictures is not None
    dice = np.random.default_rng(8)
    parts, lines = [], []
    for name in pictures.names:
        scene = pictures.load(name)
        found = [shaken(truth, dice) for truth in scene.fruits if dice.random() < 0.8]
        found += [found_fruit(dice.uniform([-0.3, -0.2, 0.3], [0.3, 0.2, 0.9])) for _ in range(int(dice.integers(3)))]
        parts.append(judge(scene.facts, scene.fruits, found, kinds=kinds))
        detections = [
            {**dict(zip("xyz", fruit.centre_m.tolist(), strict=True)), "diameter": fruit.diameter_m} for fruit in found
        ]
        lines.append(json.dumps({"scene_id": name, "detections": detections}))
    predictions, answer = tmp_path / "found.jsonl", tmp_path / "score.json"
    predictions.write_text("\n".join(lines), encoding="utf-8")
    command = [sys.executable, SCENE_SCORER, "--gt", SHARED / "data/greenhouse/dev", "--pred", predictions]
    command += ["--json", answer, *(["--ripeness", ",".join(kinds)] if kinds else [])]
    subprocess.run(command, check=True, capture_output=True)
    theirs = json.loads(answer.read_text(encoding="utf-8"))
    ours = together(parts)
    assert ours.precision == pytest.approx(theirs["precision"], abs=6e-5)
    assert 0.2 < theirs["precision"] < 0.9
    assert_same(asdict(statistics_of(ours.sightings)), theirs["overall"])
    for grouping in GROUPINGS:
        if grouping.key in theirs["groups"]:
            by_name = {group.name: group for group in grouped(ours, grouping)}
            assert by_name.keys() == theirs["groups"][grouping.key].keys()
            for name, group in by_name.items():
                assert_same(asdict(group.statistics), theirs["groups"][grouping.key][name])


def assert_same(ours: dict[str, Any], theirs: dict[str, Any]) -> None:
    names = {
        "eligible": "n",
        "recognised": "recognised",
        "recognition": "rate",
        "error_median_mm": "err3d_median_mm",
        "error_p95_mm": "err3d_p95_mm",
        "depth_bias_mm": "depth_bias_mm",
        "diameter_error_median_percent": "diam_abs_err_median_pct",
        "diameter_bias_percent": "diam_bias_pct",
        "diameter_error_p95_percent": "diam_abs_err_p95_pct",
    }
    for mine, yours in names.items():
        if theirs[yours] is None:
            assert ours[mine] is None
        else:
            assert ours[mine] == pytest.approx(theirs[yours], abs=5.1e-3 if yours != "rate" else 6e-5)


@pytest.mark.skipif(photographs("val") is None or not PHOTO_SCORER.is_file(), reason=ABSENT.format(PHOTO_SCORER))
def test_photographs_score_the_same_as_with_the_scorer_beside_them(tmp_path: Path) -> None:
    pictures = photographs("val")
    assert pictures is not None
    dice = np.random.default_rng(9)
    annotations, lines, judged = tmp_path / "annotations", [], []
    annotations.mkdir()
    for name in pictures.names:
        (annotations / f"{name}.xml").symlink_to((PHOTOS / "annotations" / f"{name}.xml").resolve())
        photo = pictures.load(name)
        circles = [Circle(*dice.uniform([0, 0, 10], [400, 400, 90]), Ripeness.RED, dice.random()) for _ in range(2)]
        for x0, y0, x1, y1 in photo.boxes[dice.random(len(photo.boxes)) < 0.8]:
            u, v, r = (x0 + x1) / 2, (y0 + y1) / 2, (x1 - x0 + y1 - y0) / 4
            u, v, r = u + dice.normal(0.0, 0.2 * r), v + dice.normal(0.0, 0.2 * r), r * dice.uniform(0.7, 1.3)
            circles.append(Circle(float(u), float(v), float(r), Ripeness.RED, float(dice.random())))
        judged.append(judge_photo(photo, circles))
        lines += [
            json.dumps({"image": f"{name}.jpg", "u": c.u_px, "v": c.v_px, "r_px": c.r_px, "confidence": c.confidence})
            for c in circles
        ]
    predictions = tmp_path / "found.jsonl"
    predictions.write_text("\n".join(lines), encoding="utf-8")
    done = subprocess.run(
        [sys.executable, PHOTO_SCORER, annotations, predictions], check=True, capture_output=True, text=True
    )
    last = done.stdout.splitlines()[-1]
    theirs = [float(text) for text in re.findall(r"(?:recall|precision|F1|AP50) ([0-9.]+)", last)]
    score = photo_score(judged)
    assert [score.recall, score.precision, score.f1, score.ap50] == pytest.approx(theirs, abs=6e-4)
    assert 0.1 < score.f1 < 0.95
    for names in (rows for key, rows in recall_by_group(judged).items() if key != "light"):
        for name, (hits, count) in names.items():
            assert re.search(rf"^{re.escape(name)} +{hits}/{count} ", done.stdout, re.MULTILINE)


def test_what_is_eligible_may_be_some_ripeness_only() -> None:
    truths = [true_fruit(0.0), replace(true_fruit(0.3), ripeness="green")]
    judged = judge(SCENE, truths, [found_fruit([0.0, 0.0, 0.6])], kinds=("green",))
    assert len(judged.sightings) == 1
    assert judged.precision == 1.0

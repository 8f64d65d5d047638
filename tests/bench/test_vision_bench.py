"""The vision bench itself, on few scenes of the twin."""

from __future__ import annotations

import json
import re
import xml.etree.ElementTree as ET
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from robot.vision.values import Fruit
from tests.bench.vision import __main__ as bench
from tests.bench.vision.compare import differences, read_numbers
from tests.bench.vision.contestants import CONTESTANTS, make_staged
from tests.bench.vision.datasets import ABSENT, GREENHOUSE
from tests.bench.vision.goals import GOALS, goal_rows, verdict_of
from tests.bench.vision.labelled import Image, light_percent, spread
from tests.bench.vision.page import render
from tests.bench.vision.plots import Point, Series, chart
from tests.bench.vision.results import Results, look_at_scenes, numbers
from tests.bench.vision.rivals import ExcessGreenValues, HoughValues, Rival, located
from tests.bench.vision.scoring import statistics_of
from tests.bench.vision.throughput import detect_folder
from tests.bench.vision.timing import REST, TOTAL, measure
from tests.bench.vision.twin_scenes import rig_of, twin_rows, twin_singles
from tests.robot.vision.spheres import Ball, photograph, small_rig


@pytest.fixture(scope="module")
def results() -> Results:
    """Two scenes of rows and two single fruit, for every contestant."""
    said: list[str] = []
    rows = twin_rows().first(2)
    some = look_at_scenes(rows, said.append)
    single = look_at_scenes(twin_singles(0.5, 2), said.append)
    assert len(said) == 2 * len(CONTESTANTS)
    time = measure("fruit", partial(make_staged, "fruit"), rows.title, [rows.load(rows.names[0])], 1)
    return Results(None, None, some, {0.5: single}, (time,), None, ("no other pictures",))


def test_single_fruit_are_wholly_in_both_views_at_their_distance() -> None:
    pictures = twin_singles(0.3, 3)
    scenes = [pictures.load(name) for name in pictures.names]
    for scene in scenes:
        (fruit,) = scene.fruits
        assert fruit.visible_fraction > 0.995
        assert fruit.centre_m[2] == pytest.approx(0.3)
        assert 0.05 <= fruit.diameter_m <= 0.12
        assert scene.rig.image_size == (1280, 720) == scene.left.shape[1::-1]
        assert fruit.left_px[:2] == pytest.approx(scene.rig.project_left(fruit.centre_m)[0], abs=1e-3)
    assert {scene.fruits[0].ripeness for scene in scenes} == {"red", "turning", "green"}
    assert {bool(scene.rig.dist_left.any()) for scene in scenes} == {True, False}


def test_a_scene_is_the_same_each_time_it_is_loaded() -> None:
    for pictures in (twin_rows(), twin_singles(0.8)):
        name = pictures.names[5]
        one = pictures.load(name)
        pictures.load(pictures.names[40 % len(pictures.names)])
        again = pictures.load(name)
        assert np.array_equal(one.left, again.left)
        assert np.array_equal(one.right, again.right)
        assert [fruit.id for fruit in one.fruits] == [fruit.id for fruit in again.fruits]


def test_rows_get_dark_and_the_lamp_helps() -> None:
    lights = {
        hour: twin_rows().load(f"row31_640_{hour}_stop0").facts.light_percent for hour in ("12h", "20h", "20h_lamp")
    }
    assert lights["20h"] < 0.2 * lights["20h_lamp"] < 0.05 * lights["12h"]


def test_light_is_a_share_of_white_after_the_curve_is_undone() -> None:
    assert light_percent(np.full((4, 4, 3), 255, np.uint8)) == pytest.approx(100.0)
    assert light_percent(np.full((4, 4, 3), 188, np.uint8)) == pytest.approx(50.0, abs=0.5)
    assert spread(tuple("abcdefgh"), 4) == ("a", "c", "e", "g")


@pytest.mark.parametrize("values", [HoughValues(votes=15.0), ExcessGreenValues()])
def test_rivals_find_a_plain_red_ball_and_its_place(values: HoughValues | ExcessGreenValues) -> None:
    rig = small_rig(tilted=True)
    ball = Ball((0.03, -0.02, 0.5), 0.08)
    left, right = photograph([ball], rig)
    (fruit,) = Rival(values, values).detect(left, right, rig)
    assert np.linalg.norm(fruit.centre_m - np.array(ball.centre_m)) < 0.02
    assert fruit.diameter_m == pytest.approx(ball.diameter_m, rel=0.1)
    assert fruit.ripeness == "red"


def test_pairs_that_are_no_fruit_by_their_size_are_left_out() -> None:
    rig = small_rig(tilted=False)
    left, right = photograph([Ball((0.0, 0.0, 0.5), 0.24)], rig)
    circles = [ExcessGreenValues(max_radius=0.5).circles(image) for image in (left, right)]
    assert len(circles[0]) == len(circles[1]) == 1
    assert located(circles[0], circles[1], rig, 0.01) == ()
    assert located((), circles[1], rig, 0.01) == ()


def test_fruit_measures_single_fruit_of_the_twin_to_millimetres(results: Results) -> None:
    figures = statistics_of(results.singles[0.5].judged("fruit").sightings)
    assert figures.recognised == figures.eligible == 2
    assert figures.error_median_mm is not None
    assert 0.0 < figures.error_median_mm < 5.0


def test_the_numbers_say_what_was_seen(results: Results) -> None:
    out = numbers(results)
    assert set(out["scenes"]) == {"twin_rows_640", "twin_single_500mm"}
    for contestant in CONTESTANTS:
        figures = out["scenes"]["twin_rows_640"][contestant.key]
        judged = results.rows.judged(contestant.key)
        seen = [fruit for scene in results.rows.seen[contestant.key] for fruit in scene.truths]
        assert figures["eligible"] == sum(fruit.visible_fraction >= 0.6 for fruit in seen) > 5
        assert figures["recognised"] == sum(sighting.found is not None for sighting in judged.sightings)
        assert figures["detections"] == len(judged.detections)
        for group in figures["by"].values():
            assert sum(one["eligible"] for one in group.values()) == figures["eligible"]
            assert sum(one["recognised"] for one in group.values()) == figures["recognised"]
    fruit, paper = (out["scenes"]["twin_rows_640"][key]["recognition"] for key in ("fruit", "paper"))
    assert fruit > paper


def test_goals_without_their_pictures_are_not_measured_and_none_is_met_by_half(results: Results) -> None:
    rows = {row.quantity: row for row in goal_rows(results)}
    assert len(rows) == len(GOALS) + 2
    assert rows["recognition, all"].verdict == "not measured"
    three_errors = next(goal for goal in GOALS if len(goal.goal) == 3)
    assert verdict_of(three_errors, three_errors.stretch) == "stretch met"
    assert verdict_of(three_errors, three_errors.goal) == "met"
    assert verdict_of(three_errors, (0.0, 0.0, 9.0)) == "not met"
    assert verdict_of(three_errors, (0.0, None, 0.0)) == "not measured"
    bias = next(goal for goal in GOALS if goal.better == "nearer to 0")
    assert verdict_of(bias, (-0.6, 0.0, 0.0)) == "not met"


def test_the_page_holds_its_pictures_and_asks_for_nothing(results: Results) -> None:
    page = render(results, "now")
    assert not re.search(r"(?:src|href)=\"(?!data:)", page)
    misses = [s for s in results.rows.judged("paper").sightings if s.found is None]
    assert page.count('alt="miss: ') >= min(10, len(misses)) > 0
    assert page.count('alt="hit: ') > 0
    assert "no other pictures" in page
    for svg in re.findall(r"<svg.*?</svg>", page, re.DOTALL):
        ET.fromstring(svg)


def test_a_chart_puts_values_where_its_axis_says() -> None:
    points = (Point(0.0, 0.0, 20.0, "none"), None, Point(100.0, 80.0, 100.0, "all"))
    svg = chart("t", ["a", "b", "c"], [1, 2, 3], "x", "%", [Series("s", "#123456", "circle", points)], 100.0)
    root = ET.fromstring(svg)
    lines = sorted(float(line.attrib["y1"]) for line in root.iter("line"))
    heights = [float(mark.attrib["cy"]) for mark in root.iter("circle")]
    assert heights == [lines[-1], lines[0]]


class _Staged:
    """Burns CPU in two stages and a rest."""

    def __init__(self, on_stage: Callable[[str], None]) -> None:
        self._on_stage = on_stage

    def detect(self, left: Image, right: Image, rig: object) -> tuple[Fruit, ...]:
        for stage, rounds in (("short", 20_000), ("long", 200_000)):
            sum(range(rounds))
            self._on_stage(stage)
        return ()

    def detect_mono(self, image: Image) -> tuple[()]:
        return ()


def test_stages_are_told_apart_and_add_up() -> None:
    pictures = twin_rows()
    row = measure("staged", _Staged, "p", [pictures.load(pictures.names[0])], 1)
    times = {stage.stage: stage.median_ms for stage in row.stages}
    assert list(times) == ["short", "long", REST, TOTAL]
    assert times["long"] > times["short"] > 0.0
    assert times[TOTAL] == pytest.approx(times["short"] + times["long"] + times[REST])
    assert row.size == "640x480"


def test_runs_are_compared_number_by_number(results: Results, tmp_path: Path) -> None:
    record = tmp_path / "bench.json"
    before = numbers(results)
    record.write_text(json.dumps(before), encoding="utf-8")
    again = json.loads(json.dumps(before))
    assert differences(read_numbers(record), again) == ()
    again["scenes"]["twin_rows_640"]["fruit"]["recognised"] += 1
    (changed,) = differences(before, again)
    assert changed.path == "scenes > twin_rows_640 > fruit > recognised"
    assert changed.after == (changed.before or 0) + 1
    record.write_text("[]", encoding="utf-8")
    with pytest.raises(ValueError, match=r"bench\.json"):
        read_numbers(record)


def test_rigs_of_the_twin_are_as_wide_at_both_sizes() -> None:
    wide = [2 * np.degrees(np.arctan(rig.image_size[0] / 2 / rig.K_left[0, 0])) for rig in map(rig_of, ("640", "1280"))]
    assert wide == pytest.approx([70.0, 70.0], abs=0.05)


@pytest.mark.skipif(not (GREENHOUSE / "train").is_dir(), reason=ABSENT.format(GREENHOUSE))
def test_sprayer_detect_is_watched_with_all_its_processes() -> None:
    run = detect_folder(GREENHOUSE / "train", 3)
    assert run.pairs == 3
    assert 0.1 < run.pairs_per_s < 1000.0
    assert run.processes >= 1
    assert 30.0 < run.pss_mb <= 1.05 * run.rss_mb < 2000.0
    assert run.cores_busy > 0.0


@pytest.mark.long
def test_one_command_writes_the_page_and_the_numbers(tmp_path: Path) -> None:
    assert bench.main(["--quick", "--twin-only", "--out", str(tmp_path)]) == 0
    record = read_numbers(tmp_path / "bench.json")
    assert record["scenes"]["twin_single_300mm"]["fruit"]["scenes"] == 3
    assert any("1280x720, fruit" in name for name in record["milliseconds"])
    assert (tmp_path / "index.html").stat().st_size > 200_000

"""The goals, what was measured against them, and whether they are met."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass
from typing import Literal

from tests.bench.vision.contestants import Key
from tests.bench.vision.groups import GROUPINGS, SIZES, Grouping, grouped
from tests.bench.vision.results import Results, StereoResult
from tests.bench.vision.scoring import Judged, Statistics, statistics_of, together
from tests.bench.vision.twin_scenes import SINGLE_DISTANCES_M

Figures = tuple[float | None, ...]
Better = Literal["more", "less", "nearer to 0"]
Verdict = Literal["stretch met", "met", "not met", "not measured"]

DUSK_AND_DAWN, NOON = (8, 18, 20), (10, 12, 14)
_SIZE: Grouping = next(grouping for grouping in GROUPINGS if grouping.key == "size")
_WITHIN = SIZES[1:5]  # 5 to 14 cm


@dataclass(frozen=True, slots=True)
class Goal:
    """A row of the table. ``figures`` gives as many numbers as ``goal`` and ``stretch`` have; ``form`` writes one."""

    quantity: str
    figures: Callable[[Results, Key], Figures]
    goal: tuple[float, ...]
    stretch: tuple[float, ...]
    better: Better
    form: str
    unit: str = ""


@dataclass(frozen=True, slots=True)
class GoalRow:
    """As the page shows it; ``measured`` are fruit's numbers."""

    quantity: str
    paper: str
    fruit: str
    goal: str
    stretch: str
    verdict: Verdict
    measured: Figures


def goal_rows(results: Results) -> tuple[GoalRow, ...]:
    """All goals in the order of the table."""
    return (*(_row(goal, results) for goal in GOALS), _honesty(results), _memory(results))


def verdict_of(goal: Goal, figures: Figures) -> Verdict:
    """By the worst of the figures; a figure that is missing is none."""
    known = [figure for figure in figures if figure is not None]
    if len(known) < len(figures) or not known:
        return "not measured"
    if all(_reached(figure, least, goal.better) for figure, least in zip(known, goal.stretch, strict=True)):
        return "stretch met"
    reached = all(_reached(figure, least, goal.better) for figure, least in zip(known, goal.goal, strict=True))
    return "met" if reached else "not met"


def _reached(figure: float, bound: float, better: Better) -> bool:
    if better == "more":
        return figure >= bound
    return (abs(figure) if better == "nearer to 0" else figure) <= bound


def _row(goal: Goal, results: Results) -> GoalRow:
    fruit = goal.figures(results, "fruit")
    sign = {"more": "≥ ", "less": "≤ ", "nearer to 0": "± "}[goal.better]
    return GoalRow(
        goal.quantity,
        _written(goal, goal.figures(results, "paper")),
        _written(goal, fruit),
        sign + _written(goal, goal.goal),
        sign + _written(goal, goal.stretch),
        verdict_of(goal, fruit),
        fruit,
    )


def _written(goal: Goal, figures: Figures) -> str:
    if all(figure is None for figure in figures):
        return "–"
    texts = ["–" if figure is None else format(figure, goal.form) for figure in figures]
    return " / ".join(texts) + (f" {goal.unit}" if goal.unit else "")


def _overall(result: StereoResult | None, key: Key, kinds: Collection[str] | None = None) -> Statistics | None:
    return None if result is None else statistics_of(result.judged(key, kinds).sightings)


def _recognition(kinds: Collection[str] | None) -> Callable[[Results, Key], Figures]:
    def figures(results: Results, key: Key) -> Figures:
        overall = _overall(results.rendered, key, kinds)
        return (None if overall is None else overall.recognition,)

    return figures


def _precision(results: Results, key: Key) -> Figures:
    return (None if results.rendered is None else results.rendered.judged(key).precision,)


def _dusk_against_noon(results: Results, key: Key) -> Figures:
    if results.rendered is None:
        return (None,)
    sightings = results.rendered.judged(key).sightings
    dusk, noon = (
        statistics_of([s for s in sightings if s.scene.hour in hours]).recognition for hours in (DUSK_AND_DAWN, NOON)
    )
    return (dusk / noon if dusk is not None and noon else None,)


def _spread(results: Results, key: Key) -> Figures:
    if results.rendered is None:
        return (None,)
    rates = [
        100.0 * group.statistics.recognition
        for group in grouped(results.rendered.judged(key), _SIZE)
        if group.name in _WITHIN and group.statistics.recognition is not None
    ]
    return (max(rates) - min(rates) if rates else None,)


def _error(results: Results, key: Key) -> Figures:
    overall = _overall(results.rendered, key)
    return (None, None) if overall is None else (overall.error_median_mm, overall.error_p95_mm)


def _of_singles(name: Literal["error_median_mm", "depth_bias_mm"]) -> Callable[[Results, Key], Figures]:
    """At each distance."""

    def figures(results: Results, key: Key) -> Figures:
        overall = [_overall(results.singles.get(distance_m), key) for distance_m in SINGLE_DISTANCES_M]
        return tuple(None if one is None else getattr(one, name) for one in overall)

    return figures


def all_singles(results: Results, key: Key) -> Judged:
    """Single fruit at every distance."""
    return together(one.judged(key) for one in results.singles.values())


def _diameter(results: Results, key: Key) -> Figures:
    overall = _overall(results.rendered, key)
    alone = statistics_of(all_singles(results, key).sightings).diameter_error_median_percent
    return (alone, None if overall is None else overall.diameter_error_median_percent)


def _photo_f1(results: Results, key: Key) -> Figures:
    return (None if results.photos is None else results.photos.score(key).f1,)


def _milliseconds(size: str) -> Callable[[Results, Key], Figures]:
    """Of the first set at that size: the rendered greenhouse at 640x480 where it is there, else the twin."""

    def figures(results: Results, key: Key) -> Figures:
        rows = [row for row in results.times if row.size == size and row.contestant == key]
        return (rows[0].total.median_ms if rows else None,)

    return figures


def _honesty(results: Results) -> GoalRow:
    """The share of 3-D errors within 2 sigma: rendered greenhouse / single fruit of the twin."""
    texts: dict[Key, str] = {}
    measured: Figures = ()
    for key in ("paper", "fruit"):
        overall = _overall(results.rendered, key)
        alone = statistics_of(all_singles(results, key).sightings).in_two_sigma
        measured = (None if overall is None else overall.in_two_sigma, alone)
        texts[key] = " / ".join("–" if share is None else f"{100.0 * share:.0f} %" for share in measured)
    known = [share for share in measured if share is not None]
    honest = all(0.90 <= share <= 0.98 for share in known)
    verdict: Verdict = "not measured" if len(known) < 2 else "met" if honest else "not met"
    return GoalRow(
        "covariance: share of 3-D errors inside 2 sigma, rendered / twin unoccluded",
        texts["paper"],
        texts["fruit"],
        "90-98 %",
        "",
        verdict,
        measured,
    )


def _memory(results: Results) -> GoalRow:
    """Of ``sprayer detect`` on a folder, all processes."""
    run = results.throughput
    quantity = f"sprayer detect on {100 if run is None else run.pairs} pairs: memory of all processes, pairs a second"
    if run is None:
        return GoalRow(quantity, "–", "–", "< 400 MB", "", "not measured", (None, None))
    text = f"{run.pss_mb:.0f} MB, {run.pairs_per_s:.1f}/s with {run.cores_busy:.1f} of {run.cores} cores busy"
    return GoalRow(
        quantity, "–", text, "< 400 MB", "", "met" if run.pss_mb < 400.0 else "not met", (run.pss_mb, run.pairs_per_s)
    )


GOALS = (
    Goal(
        "recognition, red + turning, visible ≥ 0.6, all hours",
        _recognition(("red", "turning")),
        (0.97,),
        (0.99,),
        "more",
        ".3f",
    ),
    Goal("recognition, green, visible ≥ 0.6", _recognition(("green",)), (0.85,), (0.93,), "more", ".3f"),
    Goal("recognition, all", _recognition(None), (0.94,), (0.97,), "more", ".3f"),
    Goal("precision in the same run", _precision, (0.96,), (0.98,), "more", ".3f"),
    Goal(
        "dusk and dawn (8, 18, 20 h) against noon (10 to 14 h)", _dusk_against_noon, (0.93,), (0.97,), "more", ".2f"
    ),
    Goal("spread between diameter bins 5-14 cm", _spread, (5.0,), (3.0,), "less", ".1f", "points"),
    Goal("3-D error 640x480, median / 95 %", _error, (4.0, 15.0), (2.5, 10.0), "less", ".3g", "mm"),
    Goal(
        "3-D error 1280x720, unoccluded, at 0.3 / 0.5 / 0.8 m (twin), median",
        _of_singles("error_median_mm"),
        (0.6, 1.0, 2.5),
        (0.3, 0.6, 1.3),
        "less",
        ".2f",
        "mm",
    ),
    Goal(
        "depth bias, 1280x720, unoccluded, at 0.3 / 0.5 / 0.8 m (twin)",
        _of_singles("depth_bias_mm"),
        (0.5, 0.5, 0.5),
        (0.2, 0.2, 0.2),
        "nearer to 0",
        ".2f",
        "mm",
    ),
    Goal(
        "diameter, unoccluded (twin) / all found (rendered), median",
        _diameter,
        (1.0, 3.0),
        (0.5, 2.0),
        "less",
        ".2g",
        "%",
    ),
    Goal("real photos (val split), F1 at IoU 0.5", _photo_f1, (0.80,), (0.90,), "more", ".3f"),
    Goal("ms per 1280x720 pair, one core, whole pipeline", _milliseconds("1280x720"), (40.0,), (20.0,), "less", ".0f"),
    Goal("ms per 640x480 pair", _milliseconds("640x480"), (25.0,), (12.0,), "less", ".0f"),
)

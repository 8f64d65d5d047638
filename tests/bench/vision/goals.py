"""The goals, what was measured against them, and whether they are met."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from tests.bench.vision.contestants import CONTESTANTS, Key
from tests.bench.vision.goal_figures import (
    Figures,
    all_singles,
    diameter_of,
    dusk_against_noon,
    error_of,
    milliseconds,
    of_singles,
    overall_of,
    photo_f1,
    precision_of,
    recognition_of,
    spread_of,
)
from tests.bench.vision.results import Results
from tests.bench.vision.scoring import statistics_of

Better = Literal["more", "less", "nearer to 0"]
Verdict = Literal["stretch met", "met", "not met", "not measured"]


@dataclass(frozen=True, slots=True)
class Goal:
    """A row of the table. ``figures`` gives as many numbers as ``goal`` and ``stretch`` have; ``form`` writes one.

    ``short`` heads its column where all contestants stand side by side, "": it has none.
    """

    quantity: str
    figures: Callable[[Results, Key], Figures]
    goal: tuple[float, ...]
    stretch: tuple[float, ...]
    better: Better
    form: str
    unit: str = ""
    short: str = ""


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


def side_by_side(results: Results) -> tuple[tuple[str, ...], tuple[tuple[str, tuple[str, ...]], ...]]:
    """The main figures of every contestant: heads, and rows of its title and texts."""
    goals = [goal for goal in GOALS if goal.short]
    rows = tuple(
        (one.title, tuple(_written(goal, goal.figures(results, one.key)) for goal in goals)) for one in CONTESTANTS
    )
    return tuple(goal.short for goal in goals), rows


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


def _honesty(results: Results) -> GoalRow:
    """The share of 3-D errors within 2 sigma: rendered greenhouse / single fruit of the twin."""
    texts: dict[Key, str] = {}
    measured: Figures = ()
    for key in ("paper", "fruit"):
        overall = overall_of(results.rendered, key)
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
        quantity="recognition, red + turning, visible ≥ 0.6, all hours",
        figures=recognition_of(("red", "turning")),
        goal=(0.97,),
        stretch=(0.99,),
        better="more",
        form=".3f",
        short="red + turning",
    ),
    Goal(
        quantity="recognition, green, visible ≥ 0.6",
        figures=recognition_of(("green",)),
        goal=(0.85,),
        stretch=(0.93,),
        better="more",
        form=".3f",
        short="green",
    ),
    Goal(
        quantity="recognition, all",
        figures=recognition_of(None),
        goal=(0.94,),
        stretch=(0.97,),
        better="more",
        form=".3f",
        short="all",
    ),
    Goal(
        quantity="precision in the same run",
        figures=precision_of,
        goal=(0.96,),
        stretch=(0.98,),
        better="more",
        form=".3f",
        short="precision",
    ),
    Goal(
        quantity="dusk and dawn (8, 18, 20 h) against noon (10 to 14 h)",
        figures=dusk_against_noon,
        goal=(0.93,),
        stretch=(0.97,),
        better="more",
        form=".2f",
        short="dusk / noon",
    ),
    Goal(
        quantity="spread between diameter bins 5-14 cm",
        figures=spread_of,
        goal=(5.0,),
        stretch=(3.0,),
        better="less",
        form=".1f",
        unit="points",
    ),
    Goal(
        quantity="3-D error 640x480, median / 95 %",
        figures=error_of,
        goal=(4.0, 15.0),
        stretch=(2.5, 10.0),
        better="less",
        form=".3g",
        unit="mm",
        short="3-D error",
    ),
    Goal(
        quantity="3-D error 1280x720, unoccluded, at 0.3 / 0.5 / 0.8 m (twin), median",
        figures=of_singles("error_median_mm"),
        goal=(0.6, 1.0, 2.5),
        stretch=(0.3, 0.6, 1.3),
        better="less",
        form=".2f",
        unit="mm",
    ),
    Goal(
        quantity="depth bias, 1280x720, unoccluded, at 0.3 / 0.5 / 0.8 m (twin)",
        figures=of_singles("depth_bias_mm"),
        goal=(0.5, 0.5, 0.5),
        stretch=(0.2, 0.2, 0.2),
        better="nearer to 0",
        form=".2f",
        unit="mm",
    ),
    Goal(
        quantity="diameter, unoccluded (twin) / all found (rendered), median",
        figures=diameter_of,
        goal=(1.0, 3.0),
        stretch=(0.5, 2.0),
        better="less",
        form=".2g",
        unit="%",
        short="diameter",
    ),
    Goal(
        quantity="real photos (val split), F1 at IoU 0.5",
        figures=photo_f1,
        goal=(0.80,),
        stretch=(0.90,),
        better="more",
        form=".3f",
        short="photos, F1",
    ),
    Goal(
        quantity="ms per 1280x720 pair, one core, whole pipeline",
        figures=milliseconds("1280x720"),
        goal=(40.0,),
        stretch=(20.0,),
        better="less",
        form=".0f",
        short="ms, 1280x720",
    ),
    Goal(
        quantity="ms per 640x480 pair",
        figures=milliseconds("640x480"),
        goal=(25.0,),
        stretch=(12.0,),
        better="less",
        form=".0f",
        short="ms, 640x480",
    ),
)

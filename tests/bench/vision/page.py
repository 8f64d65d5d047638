"""The bench as one HTML page that asks for nothing from outside."""

from __future__ import annotations

import platform
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import jinja2
import numpy as np

from tests.bench.vision.contestants import CONTESTANTS, Contestant
from tests.bench.vision.gallery import Picture, photo_pictures, scene_pictures
from tests.bench.vision.goals import goal_rows, side_by_side
from tests.bench.vision.groups import GROUPINGS, Group, Grouping, grouped
from tests.bench.vision.photo_scoring import recall_by_group
from tests.bench.vision.plots import Point, Series, chart, legend, wilson
from tests.bench.vision.results import PhotoResult, Results, StereoResult
from tests.bench.vision.rivals import tuned
from tests.bench.vision.scoring import Judged, Statistics, statistics_of

TEMPLATE = Path(__file__).with_name("page.html.j2")
_SHOWN = tuple(g for g in GROUPINGS if g.key in ("hour", "light", "size", "distance", "visible", "ripeness"))
_FIGURES = {"hour": "Figure 6 redrawn. ", "size": "Figure 7 redrawn. "}


@dataclass(frozen=True, slots=True)
class Cell:
    """One contestant's figures in a row of a table; ``""`` for what there is not."""

    recognition: str
    precision: str
    error: str
    bias: str
    diameter: str


@dataclass(frozen=True, slots=True)
class TableRow:
    name: str
    eligible: int
    cells: tuple[Cell, ...]


@dataclass(frozen=True, slots=True)
class Table:
    title: str
    rows: tuple[TableRow, ...]


@dataclass(frozen=True, slots=True)
class Plot:
    caption: str
    svg: str


@dataclass(frozen=True, slots=True)
class StereoSection:
    title: str
    note: str
    overall: TableRow
    tables: tuple[Table, ...]
    plots: tuple[Plot, ...]
    honesty: tuple[str, ...]


def render(results: Results, when: str) -> str:
    """The page as text; ``when`` stands in its heading."""
    pictured = results.rendered if results.rendered is not None else results.rows
    environment = jinja2.Environment(
        autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    return environment.from_string(TEMPLATE.read_text(encoding="utf-8")).render(
        when=when,
        machine=f"{platform.machine()}, Python {platform.python_version()}, OpenCV {cv2.__version__}, "
        f"NumPy {np.__version__}",
        contestants=CONTESTANTS,
        legend=legend([(one.title, one.colour, one.mark) for one in CONTESTANTS]),
        absent=results.absent,
        goals=goal_rows(results),
        side_by_side=side_by_side(results),
        sections=[_section(one) for one in (results.rendered, results.rows) if one is not None],
        singles=_singles(results),
        photos=None if results.photos is None else _photos(results.photos),
        times=results.times,
        time_sets=list(dict.fromkeys((row.pictures, row.size) for row in results.times)),
        throughput=results.throughput,
        tuned=_tuned(),
        galleries=[(one, _by_kind(scene_pictures(pictured, one.key))) for one in CONTESTANTS],
        gallery_title=pictured.pictures.title,
        photo_galleries=[]
        if results.photos is None
        else [(one, photo_pictures(results.photos, one.key)) for one in CONTESTANTS],
    )


def _section(result: StereoResult) -> StereoSection:
    judged = [(one, result.judged(one.key)) for one in CONTESTANTS]
    eligible = len(judged[0][1].sightings)
    fruits = sum(len(seen.truths) for seen in result.seen[CONTESTANTS[0].key])
    plots = [_plot(result, judged, grouping, "recognition", "recognition, %") for grouping in _SHOWN]
    plots += [_plot(result, judged, g, "error", "3-D error, mm") for g in _SHOWN if g.key in ("light", "distance")]
    return StereoSection(
        title=result.pictures.title,
        note=f"{len(result.pictures.names)} scenes, {fruits} fruit, {eligible} of them eligible",
        overall=TableRow("all", eligible, tuple(_cell(statistics_of(j.sightings), j.precision) for _, j in judged)),
        tables=tuple(_table(judged, grouping) for grouping in _SHOWN),
        plots=tuple(plots),
        honesty=tuple(_percent(statistics_of(j.sightings).in_two_sigma) for _, j in judged),
    )


def _table(judged: Sequence[tuple[Contestant, Judged]], grouping: Grouping) -> Table:
    by_contestant = [grouped(of_one, grouping) for _, of_one in judged]
    rows = tuple(
        TableRow(
            groups[0].name,
            groups[0].statistics.eligible,
            tuple(_cell(group.statistics, group.precision) for group in groups),
        )
        for groups in zip(*by_contestant, strict=True)
    )
    return Table(grouping.title, rows)


def _cell(figures: Statistics, precision: float | None) -> Cell:
    median, p95 = figures.error_median_mm, figures.error_p95_mm
    return Cell(
        recognition=_percent(figures.recognition),
        precision=_percent(precision),
        error="–" if median is None or p95 is None else f"{median:.1f} / {p95:.0f}",
        bias=_signed(figures.depth_bias_mm),
        diameter="–"
        if figures.diameter_error_median_percent is None
        else f"{figures.diameter_error_median_percent:.1f} ({_signed(figures.diameter_bias_percent)})",
    )


def _plot(
    result: StereoResult, judged: Sequence[tuple[Contestant, Judged]], grouping: Grouping, what: str, unit: str
) -> Plot:
    by_contestant = [grouped(of_one, grouping) for _, of_one in judged]
    point = _recognition_point if what == "recognition" else _error_point
    series = [
        Series(one.title, one.colour, one.mark, tuple(point(group) for group in groups))
        for (one, _), groups in zip(judged, by_contestant, strict=True)
    ]
    words = "Recognition" if what == "recognition" else "Median 3-D error of the recognised"
    title = f"{words} {grouping.title}, {result.pictures.title}"
    names = [group.name for group in by_contestant[0]]
    counts = [group.statistics.eligible for group in by_contestant[0]]
    top = 100.0 if what == "recognition" else None
    bars = "Bars: 95 % Wilson intervals." if what == "recognition" else "Bars reach to the 95th percentile."
    prefix = _FIGURES.get(grouping.key, "") if what == "recognition" else ""
    return Plot(f"{prefix}{title}. {bars}", chart(title, names, counts, grouping.axis, unit, series, top))


def _recognition_point(group: Group) -> Point | None:
    figures = group.statistics
    if figures.recognition is None:
        return None
    low, high = wilson(figures.recognised, figures.eligible)
    words = f"{figures.recognised} of {figures.eligible} in {group.name}"
    return Point(100.0 * figures.recognition, 100.0 * low, 100.0 * high, words)


def _error_point(group: Group) -> Point | None:
    figures = group.statistics
    if figures.error_median_mm is None or figures.error_p95_mm is None:
        return None
    words = f"median {figures.error_median_mm:.1f} mm, 95 % {figures.error_p95_mm:.1f} mm of {figures.recognised}"
    return Point(figures.error_median_mm, figures.error_median_mm, figures.error_p95_mm, words)


def _singles(results: Results) -> list[dict[str, Any]]:
    """A row for each distance and contestant."""
    return [
        {
            "distance": f"{distance_m:g} m",
            "contestant": one.title,
            "figures": statistics_of(result.judged(one.key).sightings),
            "precision": result.judged(one.key).precision,
        }
        for distance_m, result in results.singles.items()
        for one in CONTESTANTS
    ]


def _photos(result: PhotoResult) -> dict[str, Any]:
    by_contestant = [recall_by_group(result.judged[one.key]) for one in CONTESTANTS]
    rows = [
        (name, count, [f"{100 * of_one[grouping][name][0] / count:.0f} %" for of_one in by_contestant])
        for grouping, names in by_contestant[0].items()
        for name, (_, count) in names.items()
    ]
    return {
        "title": result.pictures.title,
        "scores": [(one.title, result.score(one.key)) for one in CONTESTANTS],
        "rows": rows,
    }


def _tuned() -> list[tuple[str, str, float, str, str]]:
    """Rival, kind of picture, F1 on the train split, how it was tuned, values."""
    return [
        (
            rival,
            kind,
            found["train_f1"],
            found["how"],
            ", ".join(f"{key} {value}" for key, value in found["values"].items()),
        )
        for rival, kinds in tuned().items()
        for kind, found in kinds.items()
    ]


def _by_kind(pictures: Sequence[Picture]) -> list[tuple[str, list[Picture]]]:
    titles = (("hit", "Hits"), ("miss", "Misses"), ("false alarm", "False alarms"))
    return [(title, [one for one in pictures if one.kind == kind]) for kind, title in titles]


def _percent(share: float | None) -> str:
    return "–" if share is None else f"{100.0 * share:.0f} %"


def _signed(value: float | None) -> str:
    return "–" if value is None else f"{value:+.1f}"

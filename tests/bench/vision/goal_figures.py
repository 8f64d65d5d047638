"""The figures that the goals are about, of one contestant."""

from __future__ import annotations

from collections.abc import Callable, Collection
from typing import Literal

from tests.bench.vision.contestants import Key
from tests.bench.vision.groups import GROUPINGS, SIZES, Grouping, grouped
from tests.bench.vision.results import Results, StereoResult
from tests.bench.vision.scoring import Judged, Statistics, statistics_of, together
from tests.bench.vision.twin_scenes import SINGLE_DISTANCES_M

Figures = tuple[float | None, ...]

DUSK_AND_DAWN, NOON = (8, 18, 20), (10, 12, 14)
_SIZE: Grouping = next(grouping for grouping in GROUPINGS if grouping.key == "size")
_WITHIN = SIZES[1:5]  # 5 to 14 cm


def overall_of(result: StereoResult | None, key: Key, kinds: Collection[str] | None = None) -> Statistics | None:
    """Of a set that is there; ``kinds`` restricts it to some ripeness."""
    return None if result is None else statistics_of(result.judged(key, kinds).sightings)


def recognition_of(kinds: Collection[str] | None) -> Callable[[Results, Key], Figures]:
    """Recognition of the rendered fruit of some ripeness, 0 to 1."""

    def figures(results: Results, key: Key) -> Figures:
        overall = overall_of(results.rendered, key, kinds)
        return (None if overall is None else overall.recognition,)

    return figures


def precision_of(results: Results, key: Key) -> Figures:
    """On the rendered scenes, 0 to 1."""
    return (None if results.rendered is None else results.rendered.judged(key).precision,)


def dusk_against_noon(results: Results, key: Key) -> Figures:
    """Recognition at dusk, dawn and night, lamp or not, over that round noon; rendered scenes."""
    if results.rendered is None:
        return (None,)
    sightings = results.rendered.judged(key).sightings
    dusk, noon = (
        statistics_of([s for s in sightings if s.scene.hour in hours]).recognition for hours in (DUSK_AND_DAWN, NOON)
    )
    return (dusk / noon if dusk is not None and noon else None,)


def spread_of(results: Results, key: Key) -> Figures:
    """Best less worst recognition of the diameter bins, in points; rendered scenes."""
    if results.rendered is None:
        return (None,)
    rates = [
        100.0 * group.statistics.recognition
        for group in grouped(results.rendered.judged(key), _SIZE)
        if group.name in _WITHIN and group.statistics.recognition is not None
    ]
    return (max(rates) - min(rates) if rates else None,)


def error_of(results: Results, key: Key) -> Figures:
    """3-D error on the rendered scenes: median and 95th percentile, mm."""
    overall = overall_of(results.rendered, key)
    return (None, None) if overall is None else (overall.error_median_mm, overall.error_p95_mm)


def of_singles(name: Literal["error_median_mm", "depth_bias_mm"]) -> Callable[[Results, Key], Figures]:
    """A figure of single fruit of the twin at each distance, mm."""

    def figures(results: Results, key: Key) -> Figures:
        overall = [overall_of(results.singles.get(distance_m), key) for distance_m in SINGLE_DISTANCES_M]
        return tuple(None if one is None else getattr(one, name) for one in overall)

    return figures


def all_singles(results: Results, key: Key) -> Judged:
    """Single fruit at every distance."""
    return together(one.judged(key) for one in results.singles.values())


def diameter_of(results: Results, key: Key) -> Figures:
    """Median of the absolute error in per cent: single fruit of the twin, and all found of the rendered scenes."""
    overall = overall_of(results.rendered, key)
    alone = statistics_of(all_singles(results, key).sightings).diameter_error_median_percent
    return (alone, None if overall is None else overall.diameter_error_median_percent)


def photo_f1(results: Results, key: Key) -> Figures:
    """On the photographs, 0 to 1."""
    return (None if results.photos is None else results.photos.score(key).f1,)


def milliseconds(size: str) -> Callable[[Results, Key], Figures]:
    """Of the first set at that size: the rendered greenhouse at 640x480 where it is there, else the twin."""

    def figures(results: Results, key: Key) -> Figures:
        rows = [row for row in results.times if row.size == size and row.contestant == key]
        return (rows[0].total.median_ms if rows else None,)

    return figures

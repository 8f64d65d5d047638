"""Small charts as inline SVG: groups along x, one series a contestant, 95 % intervals as bars."""

from __future__ import annotations

import html
import math
from collections.abc import Sequence
from dataclasses import dataclass

_LEFT, _TOP, _WIDTH, _HEIGHT = 58.0, 14.0, 500.0, 236.0
_RIGHT, _BOTTOM = 14.0, 58.0
_STEPS = (0.1, 0.2, 0.25, 0.5, 1.0, 2.0, 2.5, 5.0, 10.0, 20.0, 25.0, 50.0, 100.0)


@dataclass(frozen=True, slots=True)
class Point:
    """In one group: the value and the interval it lies in (None: not known), and the words of its tool tip."""

    value: float
    low: float | None
    high: float | None
    words: str


@dataclass(frozen=True, slots=True)
class Series:
    """One contestant's points by group; None where it has none."""

    title: str
    colour: str
    mark: str
    points: tuple[Point | None, ...]


def wilson(part: int, whole: int, z: float = 1.96) -> tuple[float, float]:
    """The interval of a share (Wilson 1927), 95 % by default; 0 to 1 when there is nothing to share."""
    if whole == 0:
        return 0.0, 1.0
    rate, spread = part / whole, z * z / whole
    middle = (rate + spread / 2.0) / (1.0 + spread)
    reach = z / (1.0 + spread) * math.sqrt(rate * (1.0 - rate) / whole + spread / (4.0 * whole))
    return max(0.0, middle - reach), min(1.0, middle + reach)


def chart(
    title: str,
    groups: Sequence[str],
    counts: Sequence[int],
    axis: str,
    unit: str,
    series: Sequence[Series],
    top: float | None = None,
) -> str:
    """SVG text. ``counts`` of eligible fruit stand under the groups' names; ``top`` ends the y axis, else it fits."""
    values = [
        bound
        for one in series
        for point in one.points
        if point is not None
        for bound in (point.value, point.high if point.high is not None else point.value)
    ]
    step, highest = _scale(top if top is not None else 1.05 * max([1e-9, *values]), fixed=top is not None)
    parts = [_opening(title), _grid(step, highest, unit)]
    slot = _WIDTH / max(1, len(groups))
    for k, (group, count) in enumerate(zip(groups, counts, strict=True)):
        x = _LEFT + (k + 0.5) * slot
        parts.append(_text(x, _TOP + _HEIGHT + 17.0, group, "tick", "middle"))
        parts.append(_text(x, _TOP + _HEIGHT + 31.0, f"n {count}", "count", "middle"))
    parts.append(_text(_LEFT + _WIDTH / 2.0, _TOP + _HEIGHT + 50.0, axis, "axis", "middle"))
    spacing = min(13.0, slot / (len(series) + 1.5))
    for number, one in enumerate(series):
        shift = (number - (len(series) - 1) / 2.0) * spacing
        places = [
            (_LEFT + (k + 0.5) * slot + shift, point) for k, point in enumerate(one.points) if point is not None
        ]
        parts.append(_line(one, places, highest))
    return "".join([*parts, "</svg>"])


def legend(series: Sequence[tuple[str, str, str]]) -> str:
    """Of (title, colour, mark): an HTML list."""
    box = '<svg viewBox="-8 -8 16 16" aria-hidden="true">'
    items = "".join(
        f"<li>{box}{_mark(0.0, 0.0, colour, mark)}</svg>{html.escape(title)}</li>" for title, colour, mark in series
    )
    return f'<ul class="key">{items}</ul>'


def _scale(highest: float, *, fixed: bool) -> tuple[float, float]:
    """The step of the grid and the axis' end."""
    step = next((step for step in _STEPS if highest / step <= 6.0), _STEPS[-1])
    return step, highest if fixed else step * math.ceil(highest / step)


def _opening(title: str) -> str:
    width, height = _LEFT + _WIDTH + _RIGHT, _TOP + _HEIGHT + _BOTTOM
    label = html.escape(title, quote=True)
    box = f'viewBox="0 0 {width:.0f} {height:.0f}"'
    return f'<svg class="chart" {box} role="img" aria-label="{label}"><title>{label}</title>'


def _grid(step: float, highest: float, unit: str) -> str:
    parts = []
    for k in range(int(highest / step + 1e-6) + 1):
        y = _y(k * step, highest)
        parts.append(f'<line class="grid" x1="{_LEFT}" x2="{_LEFT + _WIDTH}" y1="{y:.1f}" y2="{y:.1f}"/>')
        parts.append(_text(_LEFT - 8.0, y + 4.0, f"{k * step:g}", "tick", "end"))
    place = f'transform="rotate(-90)" x="{-(_TOP + _HEIGHT / 2.0):.1f}" y="15"'
    parts.append(f'<text class="axis" text-anchor="middle" {place}>{html.escape(unit)}</text>')
    return "".join(parts)


def _line(one: Series, places: Sequence[tuple[float, Point]], highest: float) -> str:
    path = " ".join(f"{x:.1f},{_y(point.value, highest):.1f}" for x, point in places)
    parts = [f'<polyline class="line" stroke="{one.colour}" points="{path}"/>']
    for x, point in places:
        parts.append(f"<g><title>{html.escape(f'{one.title}: {point.words}')}</title>")
        if point.low is not None and point.high is not None:
            low, high = _y(point.low, highest), _y(min(point.high, highest), highest)
            parts.append(
                f'<path class="bar" stroke="{one.colour}" d="M{x:.1f} {low:.1f} V{high:.1f} '
                f'M{x - 3:.1f} {low:.1f} h6 M{x - 3:.1f} {high:.1f} h6"/>'
            )
        parts.append(_mark(x, _y(point.value, highest), one.colour, one.mark) + "</g>")
    return "".join(parts)


def _mark(x: float, y: float, colour: str, mark: str) -> str:
    shapes = {
        "circle": f'<circle cx="{x:.1f}" cy="{y:.1f}" r="4.6"',
        "square": f'<rect x="{x - 4.2:.1f}" y="{y - 4.2:.1f}" width="8.4" height="8.4"',
        "diamond": f'<path d="M{x:.1f} {y - 5.6:.1f} l5.6 5.6 l-5.6 5.6 l-5.6 -5.6 z"',
        "triangle": f'<path d="M{x:.1f} {y - 5.4:.1f} l5.4 9.6 h-10.8 z"',
    }
    return f'{shapes[mark]} fill="{colour}" class="mark"/>'


def _y(value: float, highest: float) -> float:
    return _TOP + _HEIGHT * (1.0 - value / highest)


def _text(x: float, y: float, words: str, style: str, anchor: str) -> str:
    return f'<text class="{style}" text-anchor="{anchor}" x="{x:.1f}" y="{y:.1f}">{html.escape(words)}</text>'

"""The area that the base must not leave: a simple polygon in the row frame."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

Point = tuple[float, float]
SMALLEST_M2 = 0.5


@dataclass(frozen=True, slots=True)
class Geofence:
    """``corners`` (x, y) in metres, row frame, in order round the area. ``ValueError`` when they are no polygon."""

    corners: tuple[Point, ...]

    def __post_init__(self) -> None:
        corners = self.corners
        if len(corners) < 3:
            raise ValueError(f"a geofence needs at least 3 corners, found {len(corners)}")
        if not all(math.isfinite(value) for corner in corners for value in corner):
            raise ValueError("a geofence's corners must be finite numbers of metres")
        edges = _edges(corners)
        for number, edge in enumerate(edges, 1):
            if math.dist(*edge) < 1e-6:
                raise ValueError(f"the geofence's corner {number} {edge[0]} is there twice; remove one")
        for i, first in enumerate(edges):
            for k in range(i + 2, len(edges)):
                if (i, k) != (0, len(edges) - 1) and _cross(first, edges[k]):
                    raise ValueError(
                        f"the geofence crosses itself: the sides from corner {i + 1} and from corner {k + 1} meet; "
                        "give the corners in order round the area"
                    )
        if self.area_m2 < SMALLEST_M2:
            raise ValueError(f"the geofence encloses {self.area_m2:.3f} m2, expected at least {SMALLEST_M2} m2")

    @property
    def area_m2(self) -> float:
        """By the shoelace formula."""
        return abs(sum(x0 * y1 - x1 * y0 for (x0, y0), (x1, y1) in _edges(self.corners))) / 2

    def margin_m(self, x_m: float, y_m: float, sigma_m: float = 0.0) -> float:
        """Distance to the nearest side, negative outside, less twice the position's standard deviation."""
        point = (x_m, y_m)
        distance_m = min(_distance(point, edge) for edge in _edges(self.corners))
        inside = sum(_passes(point, edge) for edge in _edges(self.corners)) % 2 == 1
        return (distance_m if inside else -distance_m) - 2.0 * sigma_m


def _edges(corners: Sequence[Point]) -> list[tuple[Point, Point]]:
    return list(zip(corners, [*corners[1:], corners[0]], strict=True))


def _passes(point: Point, edge: tuple[Point, Point]) -> bool:
    """Whether a ray from the point along x meets the edge."""
    (x, y), ((x0, y0), (x1, y1)) = point, edge
    return (y0 > y) != (y1 > y) and x < x0 + (y - y0) * (x1 - x0) / (y1 - y0)


def _distance(point: Point, edge: tuple[Point, Point]) -> float:
    (x, y), ((x0, y0), (x1, y1)) = point, edge
    dx, dy = x1 - x0, y1 - y0
    share = min(1.0, max(0.0, ((x - x0) * dx + (y - y0) * dy) / (dx * dx + dy * dy)))
    return math.hypot(x - x0 - share * dx, y - y0 - share * dy)


def _cross(a: tuple[Point, Point], b: tuple[Point, Point]) -> bool:
    """Whether two edges meet, touching included."""
    turns = [_turn(*a, b[0]), _turn(*a, b[1]), _turn(*b, a[0]), _turn(*b, a[1])]
    if turns[0] * turns[1] < 0 and turns[2] * turns[3] < 0:
        return True
    ends = ((a, b[0]), (a, b[1]), (b, a[0]), (b, a[1]))
    return any(turn == 0.0 and _distance(point, edge) == 0.0 for turn, (edge, point) in zip(turns, ends, strict=True))


def _turn(origin: Point, along: Point, point: Point) -> float:
    return (along[0] - origin[0]) * (point[1] - origin[1]) - (along[1] - origin[1]) * (point[0] - origin[0])

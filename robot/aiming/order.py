"""In which order to visit postures so that the arm travels little."""

from __future__ import annotations

import numpy as np

from robot.aiming.trajectory import MotionLimits, travel_time_s
from robot.geometry import Vector


def visiting_order(
    goals_rad: Vector, start_rad: Vector, limits: MotionLimits, end_rad: Vector | None = None
) -> tuple[int, ...]:
    """Indices of ``goals_rad`` (k, n) in an order of short joint-space travel from ``start_rad`` (n,), and on to
    ``end_rad`` (n,) when given. Nearest neighbour, then 2-opt and moving single goals until neither helps."""
    goals = np.asarray(goals_rad, dtype=np.float64)
    count = len(goals)
    if count < 2:
        return tuple(range(count))
    nodes = [np.asarray(start_rad)[None], goals] + ([] if end_rad is None else [np.asarray(end_rad)[None]])
    points = np.concatenate(nodes)
    time_s = travel_time_s(points[:, None, :] - points[None, :, :], limits)
    tour = _nearest_neighbour(time_s, count)
    if end_rad is not None:
        tour.append(count + 1)
    fixed_end = end_rad is not None
    while _improve_once(tour, time_s, fixed_end):
        pass
    return tuple(node - 1 for node in tour[1 : count + 1])


def _nearest_neighbour(time_s: Vector, count: int) -> list[int]:
    tour, left = [0], set(range(1, count + 1))
    while left:
        tour.append(min(left, key=lambda node: (float(time_s[tour[-1], node]), node)))
        left.remove(tour[-1])
    return tour


def _improve_once(tour: list[int], time_s: Vector, fixed_end: bool) -> bool:
    """Make the first change found that shortens the tour; False when none does."""
    last = len(tour) - (1 if fixed_end else 0)
    before_s = _length_s(tour, time_s)
    for first in range(1, last):
        for stop in range(first + 2, last + 1):
            options = (
                tour[:first] + tour[first:stop][::-1] + tour[stop:],
                [*tour[:first], *tour[first + 1 : stop], tour[first], *tour[stop:]],
                [*tour[:first], tour[stop - 1], *tour[first : stop - 1], *tour[stop:]],
            )
            for option in options:
                if _length_s(option, time_s) < before_s - 1e-9:
                    tour[:] = option
                    return True
    return False


def _length_s(tour: list[int], time_s: Vector) -> float:
    return float(time_s[tour[:-1], tour[1:]].sum())

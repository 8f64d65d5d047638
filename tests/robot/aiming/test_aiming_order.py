from __future__ import annotations

from itertools import pairwise, permutations

import numpy as np
import pytest

from robot.aiming import MotionLimits, travel_time_s, visiting_order

LIMITS = MotionLimits(np.full(6, 1.5), np.full(6, 4.0))
START = np.zeros(6)


def _travel_s(order: tuple[int, ...], goals: np.ndarray, end: np.ndarray | None = None) -> float:
    stations = [START, *goals[list(order)], *([] if end is None else [end])]
    return sum(float(travel_time_s(b - a, LIMITS)) for a, b in pairwise(stations))


def test_every_goal_is_visited_once() -> None:
    goals = np.random.default_rng(0).uniform(-1, 1, (17, 6))
    assert sorted(visiting_order(goals, START, LIMITS)) == list(range(17))


@pytest.mark.parametrize("seed", range(5))
def test_six_goals_are_ordered_nearly_as_well_as_possible(seed: int) -> None:
    goals = np.random.default_rng(seed).uniform(-1, 1, (6, 6))
    best_s = min(_travel_s(order, goals) for order in permutations(range(6)))
    assert _travel_s(visiting_order(goals, START, LIMITS), goals) <= 1.03 * best_s


def test_goals_along_a_line_are_visited_along_it() -> None:
    goals = np.linspace(0.1, 1.0, 8)[::-1, None] * np.ones(6)
    assert visiting_order(goals, START, LIMITS) == (7, 6, 5, 4, 3, 2, 1, 0)


def test_the_way_to_the_end_counts() -> None:
    goals = np.stack([np.full(6, 0.2), np.full(6, -0.2)])
    assert visiting_order(goals, START, LIMITS, end_rad=np.full(6, 1.0)) == (1, 0)
    assert visiting_order(goals, START, LIMITS, end_rad=np.full(6, -1.0)) == (0, 1)


def test_none_and_one_need_no_order() -> None:
    assert visiting_order(np.empty((0, 6)), START, LIMITS) == ()
    assert visiting_order(np.ones((1, 6)), START, LIMITS) == (0,)

"""Properties of the book of targets over random rows, errors, drifts and orders."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from hypothesis import given, settings
from hypothesis import strategies as st

from robot.targets import Book, BookParameters, Sighting, TargetState, observe, with_state
from tests.robot.targets.fruit import seen

PARAMETERS = BookParameters()
seeds = st.integers(0, 2**32 - 1)


def row_of_fruit(rng: np.random.Generator, count: int) -> list[tuple[npt.NDArray[np.float64], float]]:
    """Solid fruits, none inside another; about half of them touch a neighbour."""
    fruits: list[tuple[npt.NDArray[np.float64], float]] = []
    while len(fruits) < count:
        diameter_m = rng.uniform(0.05, 0.14)
        if fruits and rng.random() < 0.5:
            centre, other_m = fruits[rng.integers(len(fruits))]
            way = rng.normal(size=3)
            place = centre + way / np.linalg.norm(way) * 0.5 * (diameter_m + other_m)
        else:
            place = rng.uniform([0.0, 0.45, 0.6], [1.0, 0.8, 1.1])
        if all(np.linalg.norm(place - c) >= 0.5 * (d + diameter_m) - 1e-9 for c, d in fruits):
            fruits.append((place, diameter_m))
    return fruits


def frame_of(
    fruits: list[tuple[npt.NDArray[np.float64], float]], rng: np.random.Generator, drift_m: npt.ArrayLike
) -> list[Sighting]:
    """A frame whose errors, with 2 mm of drift, are too small for touching fruit to be confused."""
    bound_m = np.array([0.003, 0.008, 0.003])
    return [seen(*(c + drift_m + rng.uniform(-bound_m, bound_m)), diameter_m=d) for c, d in fruits]


@given(seeds, st.integers(1, 12))
@settings(max_examples=60, deadline=None)
def test_every_fruit_seen_from_every_stop_is_one_target_in_spite_of_pose_drift(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    fruits = row_of_fruit(rng, count)
    book = Book()
    for stop in range(3):
        drift = np.append(rng.uniform(-0.001, 0.001, 2), 0.0)
        book, matches = observe(book, frame_of(fruits, rng, drift), float(stop), PARAMETERS)
        assert len({item.target_id for item in matches}) == count
    assert len(book.targets) == count


def doses_over_five_stops(rng: np.random.Generator, count: int, sigma_m: npt.ArrayLike | None) -> list[int]:
    """How often each fruit is sprayed when every open target is sprayed with probability 0.7 whenever it is seen.

    ``sigma_m`` (3,) are the one-sigma errors, with a drift of 10 mm between stops; None for bounded ones.
    """
    fruits = row_of_fruit(rng, count)
    doses = [0] * count
    book = Book()
    for stop in range(5):
        shown = [i for i in range(count) if rng.random() < 0.6]
        frame = frame_of([fruits[i] for i in shown], rng, 0.0)
        if sigma_m is not None:
            drift = np.append(rng.uniform(-0.01, 0.01, 2), 0.0)
            frame = [seen(*(fruits[i][0] + drift + rng.normal(0.0, sigma_m)), diameter_m=fruits[i][1]) for i in shown]
        book, matches = observe(book, frame, float(stop), PARAMETERS)
        for item in matches:
            if book.target(item.target_id).state is TargetState.OPEN and rng.random() < 0.7:
                doses[shown[item.index]] += 1
                book = with_state(book, item.target_id, TargetState.SPRAYED, "")
    return doses


@given(seeds, st.integers(1, 12))
@settings(max_examples=60, deadline=None)
def test_no_fruit_is_ever_offered_for_spraying_again(seed: int, count: int) -> None:
    assert max(doses_over_five_stops(np.random.default_rng(seed), count, None)) <= 1


def test_with_the_errors_of_a_real_camera_in_dense_clusters_hardly_any_fruit_is_offered_again() -> None:
    rng = np.random.default_rng(11)
    doses = [dose for _ in range(120) for dose in doses_over_five_stops(rng, 8, [0.005, 0.015, 0.005])]
    assert sum(dose > 1 for dose in doses) <= 0.004 * len(doses)
    assert sum(dose == 0 for dose in doses) <= 0.12 * len(doses)


@given(seeds, st.integers(1, 10))
@settings(max_examples=60, deadline=None)
def test_the_order_of_sightings_in_a_frame_changes_nothing(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    fruits = row_of_fruit(rng, count)
    first, second = frame_of(fruits, rng, 0.0), frame_of(fruits, rng, [0.002, 0.0, 0.0])
    book, _ = observe(Book(), first, 0.0, PARAMETERS)
    plain, matches = observe(book, second, 1.0, PARAMETERS)
    shuffled = rng.permutation(count).tolist()
    other, other_matches = observe(book, [second[i] for i in shuffled], 1.0, PARAMETERS)
    assert [t.id for t in plain.targets] == [t.id for t in other.targets]
    assert [t.state for t in plain.targets] == [t.state for t in other.targets]
    for a, b in zip(plain.targets, other.targets, strict=True):
        np.testing.assert_array_equal(a.centre_m, b.centre_m)
    assert {shuffled[item.index]: item.target_id for item in other_matches} == {
        item.index: item.target_id for item in matches
    }


@given(seeds, st.integers(1, 10))
@settings(max_examples=60, deadline=None)
def test_seeing_the_same_frame_again_moves_nothing_and_adds_nothing(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    frame = frame_of(row_of_fruit(rng, count), rng, 0.0)
    once, _ = observe(Book(), frame, 0.0, PARAMETERS)
    twice, matches = observe(once, frame, 0.0, PARAMETERS)
    assert not any(item.new for item in matches)
    for a, b in zip(once.targets, twice.targets, strict=True):
        np.testing.assert_allclose(a.centre_m, b.centre_m, atol=1e-9)
        assert (a.id, a.state) == (b.id, b.state)
        assert abs(a.diameter_m - b.diameter_m) < 1e-9


@given(seeds, st.integers(1, 8))
@settings(max_examples=40, deadline=None)
def test_covariances_stay_symmetric_and_positive(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    fruits = row_of_fruit(rng, count)
    book = Book()
    for stop in range(6):
        book, _ = observe(book, frame_of(fruits, rng, 0.0), float(stop), PARAMETERS)
    for target in book.targets:
        np.testing.assert_array_equal(target.covariance_m2, target.covariance_m2.T)
        assert np.linalg.eigvalsh(target.covariance_m2)[0] > 0.0

"""The book merges what is one fruit, keeps apart what is two, and never lets one be sprayed twice."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from robot.geometry import transform_from_xyz_rpy
from robot.targets import (
    Book,
    BookParameters,
    Policy,
    TargetState,
    book_of,
    match,
    observe,
    sighting,
    wanted,
    with_state,
)
from robot.vision.values import Circle, Fruit, Ripeness
from tests.robot.targets.fruit import COVARIANCE, seen

PARAMETERS = BookParameters()


def sprayed(book: Book, target_id: int) -> Book:
    return with_state(book, target_id, TargetState.SPRAYED, "dosed")


def test_first_frame_gives_one_open_target_a_fruit() -> None:
    book, matches = observe(Book(), [seen(0.1), seen(0.3)], 1.0, PARAMETERS)
    assert [target.state for target in book.targets] == [TargetState.OPEN] * 2
    assert [item.new for item in matches] == [True, True]


def test_second_sighting_with_a_small_error_is_the_same_fruit() -> None:
    book, _ = observe(Book(), [seen(0.1, 0.60)], 1.0, PARAMETERS)
    book, matches = observe(book, [seen(0.104, 0.63)], 2.0, PARAMETERS)
    (target,) = book.targets
    assert (target.sightings, target.last_seen_s) == (2, 2.0)
    assert not matches[0].new
    np.testing.assert_allclose(matches[0].offset_m, [0.004, 0.03, 0.0], atol=1e-12)


def test_merged_centre_is_the_inverse_covariance_mean() -> None:
    sharp = np.eye(3) * 0.002**2
    blurred = np.eye(3) * 0.02**2
    book, _ = observe(Book(), [seen(0.10, covariance=blurred)], 1.0, PARAMETERS)
    book, _ = observe(book, [seen(0.12, covariance=sharp)], 2.0, PARAMETERS)
    aged = 0.02**2 + PARAMETERS.pose_sigma_m**2
    expected = 0.10 + 0.02 * aged / (aged + 0.002**2)
    assert book.targets[0].centre_m[0] == pytest.approx(expected, abs=1e-6)
    assert book.targets[0].covariance_m2[0, 0] < 0.002**2


def test_many_sightings_average_out_their_errors() -> None:
    rng = np.random.default_rng(3)
    book = Book()
    for frame in range(12):
        error = rng.multivariate_normal(np.zeros(3), COVARIANCE)
        book, _ = observe(book, [seen(0.1 + error[0], 0.6 + error[1], 0.9 + error[2])], float(frame), PARAMETERS)
    assert len(book.targets) == 1
    assert np.linalg.norm(book.targets[0].centre_m - [0.1, 0.6, 0.9]) < 0.012


def test_touching_fruits_of_one_frame_stay_two_targets_over_several_stops() -> None:
    cluster = [(0.10, 0.60, 0.90), (0.17, 0.60, 0.90), (0.135, 0.63, 0.952)]
    rng = np.random.default_rng(1)
    book = Book()
    for stop in range(4):
        drift = np.array([0.010, -0.005, 0.0]) * (stop % 2)
        frame = [seen(*(np.array(c) + drift + rng.multivariate_normal(np.zeros(3), COVARIANCE))) for c in cluster]
        book, _ = observe(book, frame, float(stop), PARAMETERS)
    assert len(book.targets) == 3
    assert {target.state for target in book.targets} == {TargetState.OPEN}
    assert {target.sightings for target in book.targets} == {4}


def test_sighting_beside_an_unseen_sprayed_target_is_doubtful_and_names_it() -> None:
    book, _ = observe(Book(), [seen(0.1, 0.60)], 1.0, PARAMETERS)
    book = sprayed(book, 1)
    book, matches = observe(book, [seen(0.1, 0.661)], 2.0, PARAMETERS)
    assert matches[0].new
    assert book.target(2).state is TargetState.DOUBTFUL
    assert book.target(2).reason == "may be target 1, already sprayed"
    assert book.pending() == ()


def test_uncertain_targets_are_protected_like_sprayed_ones() -> None:
    book, _ = observe(Book(), [seen(0.1, 0.60)], 1.0, PARAMETERS)
    book = with_state(book, 1, TargetState.UNCERTAIN, "crash")
    book, _ = observe(book, [seen(0.1, 0.661)], 2.0, PARAMETERS)
    assert book.target(2).reason == "may be target 1, already uncertain"


def test_touching_neighbour_seen_together_with_the_sprayed_fruit_is_open() -> None:
    book, _ = observe(Book(), [seen(0.10)], 1.0, PARAMETERS)
    book = sprayed(book, 1)
    book, _ = observe(book, [seen(0.10), seen(0.165)], 2.0, PARAMETERS)
    assert book.target(1).state is TargetState.SPRAYED
    assert book.target(2).state is TargetState.OPEN


def test_second_detection_of_a_sprayed_fruit_in_one_frame_is_doubtful() -> None:
    book, _ = observe(Book(), [seen(0.10)], 1.0, PARAMETERS)
    book = sprayed(book, 1)
    book, _ = observe(book, [seen(0.10), seen(0.10, 0.64)], 2.0, PARAMETERS)
    assert book.target(2).state is TargetState.DOUBTFUL


def test_doubt_ends_when_both_fruits_are_seen_in_one_frame() -> None:
    book, _ = observe(Book(), [seen(0.10)], 1.0, PARAMETERS)
    book = sprayed(book, 1)
    book, _ = observe(book, [seen(0.163)], 2.0, PARAMETERS)
    assert book.target(2).state is TargetState.DOUBTFUL
    book, _ = observe(book, [seen(0.10), seen(0.168)], 3.0, PARAMETERS)
    assert book.target(2).state is TargetState.OPEN


def test_of_two_unsprayed_targets_that_may_be_one_fruit_only_the_seen_one_is_sprayed() -> None:
    book, _ = observe(Book(), [seen(0.1, 0.60)], 1.0, PARAMETERS)
    book, _ = observe(book, [seen(0.1, 0.661)], 2.0, PARAMETERS)
    assert book.target(1).state is TargetState.DOUBTFUL
    assert book.target(1).reason == "may be target 2, better seen"
    assert [target.id for target in book.pending()] == [2]


def test_a_weak_sighting_does_not_displace_a_well_seen_target() -> None:
    book, _ = observe(Book(), [seen(0.1, 0.60, confidence=0.95)], 1.0, PARAMETERS)
    book, _ = observe(book, [seen(0.1, 0.661, confidence=0.3)], 2.0, PARAMETERS)
    assert [target.id for target in book.pending()] == [1]


def test_a_fruit_two_diameters_away_is_another_fruit() -> None:
    book, _ = observe(Book(), [seen(0.1)], 1.0, PARAMETERS)
    book = sprayed(book, 1)
    book, _ = observe(book, [seen(0.24)], 2.0, PARAMETERS)
    assert book.target(2).state is TargetState.OPEN


def test_a_neighbour_of_another_size_does_not_take_the_match() -> None:
    book, _ = observe(Book(), [seen(0.10, diameter_m=0.10), seen(0.17, diameter_m=0.05)], 1.0, PARAMETERS)
    book, matches = observe(book, [seen(0.13, diameter_m=0.10), seen(0.20, diameter_m=0.05)], 2.0, PARAMETERS)
    assert [(item.index, item.target_id) for item in matches] == [(0, 1), (1, 2)]


def test_a_sprayed_state_is_never_taken_back() -> None:
    book, _ = observe(Book(), [seen(0.1)], 1.0, PARAMETERS)
    with pytest.raises(ValueError, match="cannot become open"):
        with_state(sprayed(book, 1), 1, TargetState.OPEN, "again")


def test_state_of_an_unknown_target_is_an_error() -> None:
    with pytest.raises(KeyError, match="no target 7"):
        with_state(Book(), 7, TargetState.SPRAYED, "")


def test_match_finds_landmarks_without_changing_the_book() -> None:
    book, _ = observe(Book(), [seen(0.1), seen(0.3)], 1.0, PARAMETERS)
    found = match(book, [seen(0.31), seen(0.9)], PARAMETERS)
    assert [(item.index, item.target_id) for item in found] == [(0, 2)]
    np.testing.assert_allclose(found[0].offset_m, [0.01, 0.0, 0.0], atol=1e-12)


def test_a_sighting_without_a_place_is_refused() -> None:
    with pytest.raises(ValueError, match="sighting 0"):
        observe(Book(), [seen(float("nan"))], 1.0, PARAMETERS)


def test_a_book_of_resumed_targets_sorts_them_and_goes_on_counting() -> None:
    book, _ = observe(Book(), [seen(0.1), seen(0.5)], 1.0, PARAMETERS)
    resumed = book_of(reversed(book.targets))
    resumed, matches = observe(resumed, [seen(0.9)], 2.0, PARAMETERS)
    assert matches[0].target_id == 3
    with pytest.raises(ValueError, match="must rise"):
        Book(tuple(reversed(book.targets)))


@pytest.mark.parametrize(
    "wrong",
    [{"same_place": 0.9, "farthest_match": 0.5}, {"overlap": 0.95}, {"gate_sigma": 0.0}, {"doubt_margin_m": -0.01}],
)
def test_parameters_that_contradict_each_other_are_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(ValueError):
        BookParameters(**wrong)


def test_a_fruit_moves_from_the_camera_to_the_row_with_its_covariance() -> None:
    circle = Circle(1.0, 1.0, 1.0, Ripeness.RED, 0.8)
    fruit = Fruit(
        centre_m=np.array([0.1, 0.0, 0.5]),
        covariance_m2=np.diag([1e-6, 1e-6, 1e-4]),
        diameter_m=0.06,
        diameter_sigma_m=0.002,
        ripeness=Ripeness.GREEN,
        ripeness_score=0.1,
        confidence=0.8,
        left=circle,
        right=circle,
        visible_fraction=0.7,
        measured=False,
    )
    # A camera that looks along row +y: optical x is row x, optical z is row y.
    row_from_camera = transform_from_xyz_rpy((1.0, 0.05, 0.9), (-np.pi / 2, 0.0, 0.0))
    moved = sighting(fruit, row_from_camera)
    np.testing.assert_allclose(moved.centre_m, [1.1, 0.55, 0.9], atol=1e-12)
    np.testing.assert_allclose(np.diag(moved.covariance_m2), [1e-6, 1e-4, 1e-6], atol=1e-12)
    assert (moved.ripeness, moved.visible_fraction, moved.measured) == (Ripeness.GREEN, 0.7, False)


def policy_case(**changes: object) -> tuple[bool, TargetState, str]:
    book, _ = observe(Book(), [seen(0.1, ripeness=Ripeness.RED)], 1.0, PARAMETERS)
    target = replace(book.targets[0], **changes)  # type: ignore[arg-type]
    verdict = wanted(target, Policy(ripeness=frozenset({Ripeness.RED})))
    return verdict.wanted, verdict.state, verdict.reason


def test_policy_wants_a_clear_red_fruit() -> None:
    assert policy_case() == (True, TargetState.OPEN, "")


@pytest.mark.parametrize(
    ("changes", "state", "words"),
    [
        ({"ripeness": Ripeness.GREEN}, TargetState.NOT_WANTED, "green fruit is not treated"),
        ({"diameter_m": 0.02}, TargetState.NOT_WANTED, "20 mm is below the least 35 mm"),
        ({"diameter_m": 0.2}, TargetState.NOT_WANTED, "200 mm is above the most 170 mm"),
        ({"confidence": 0.3}, TargetState.DOUBTFUL, "confidence 0.30 is below 0.50"),
        ({"visible_fraction": 0.2}, TargetState.DOUBTFUL, "20 % visible is below 40 %"),
    ],
)
def test_policy_says_why_a_target_is_left(changes: dict[str, object], state: TargetState, words: str) -> None:
    assert policy_case(**changes) == (False, state, words)


@pytest.mark.parametrize("wrong", [{"min_confidence": 1.2}, {"min_diameter_m": 0.2, "max_diameter_m": 0.1}])
def test_impossible_policy_is_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(ValueError):
        Policy(**wrong)

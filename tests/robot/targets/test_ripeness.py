"""Many looks make one score and one class, and a fruit at a border does not flicker."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robot.targets import Book, BookParameters, Policy, RipenessBorders, Target, classify, observe, wanted
from robot.vision.values import Ripeness
from tests.robot.targets.fruit import seen

BORDERS = RipenessBorders()
PARAMETERS = BookParameters()
GREEN, TURNING, RED = Ripeness.GREEN, Ripeness.TURNING, Ripeness.RED
scores = st.floats(0.0, 1.0)


def looked_at(*looks: tuple[float, Ripeness, float]) -> Target:
    """A fruit after looks of (score, the look's own class, confidence)."""
    book = Book()
    for frame, (score, kind, confidence) in enumerate(looks):
        book, _ = observe(
            book, [seen(0.5, ripeness=kind, score=score, confidence=confidence)], float(frame), PARAMETERS
        )
    (target,) = book.targets
    return target


@pytest.mark.parametrize(("score", "kind"), [(0.0, GREEN), (0.1, GREEN), (0.5, TURNING), (0.9, RED), (1.0, RED)])
@pytest.mark.parametrize("held", list(Ripeness))
def test_clear_of_the_borders_the_score_alone_decides(score: float, kind: Ripeness, held: Ripeness) -> None:
    assert classify(score, held, BORDERS) is kind


@pytest.mark.parametrize(
    ("score", "held", "kind"),
    [
        (0.30, GREEN, GREEN),
        (0.20, TURNING, TURNING),
        (0.80, TURNING, TURNING),
        (0.70, RED, RED),
        (0.30, RED, TURNING),  # two classes away: nothing to hold on to
        (0.70, GREEN, TURNING),
        (0.34, GREEN, TURNING),
        (0.16, TURNING, GREEN),
    ],
)
def test_within_the_band_a_fruit_keeps_its_class(score: float, held: Ripeness, kind: Ripeness) -> None:
    assert classify(score, held, BORDERS) is kind


@given(scores, st.sampled_from(Ripeness))
def test_a_class_once_given_is_given_again(score: float, held: Ripeness) -> None:
    kind = classify(score, held, BORDERS)
    assert classify(score, kind, BORDERS) is kind


@given(st.floats(0.2, 0.8), st.lists(st.floats(-0.07, 0.07), min_size=1, max_size=20))
def test_noise_within_the_band_changes_a_class_once_at_most(score: float, noise: list[float]) -> None:
    held, changes = GREEN if score < 0.5 else RED, 0
    for error in noise:
        kind = classify(score + error, held, BORDERS)
        changes += kind is not held
        held = kind
    assert changes <= 1


def test_the_score_is_the_mean_of_the_looks_by_what_each_saw() -> None:
    target = looked_at((0.2, GREEN, 0.9), (0.6, TURNING, 0.3))
    assert target.ripeness_score == pytest.approx((0.2 * 0.9 + 0.6 * 0.3) / 1.2)
    assert target.ripeness_weight == pytest.approx(1.2 * 0.9)  # each look saw 0.9 of the fruit


@given(st.lists(st.tuples(scores, st.floats(0.5, 1.0)), min_size=1, max_size=6), st.randoms())
def test_the_order_of_looks_does_not_change_the_score(looks: list[tuple[float, float]], random: object) -> None:
    shuffled = list(looks)
    random.shuffle(shuffled)  # type: ignore[attr-defined]
    one, other = (looked_at(*((score, TURNING, sure) for score, sure in order)) for order in (looks, shuffled))
    assert one.ripeness_score == pytest.approx(other.ripeness_score)
    assert min(looks)[0] - 1e-9 <= one.ripeness_score <= max(looks)[0] + 1e-9


def test_one_odd_look_does_not_turn_a_fruit_that_was_seen_well() -> None:
    assert looked_at((0.95, RED, 0.9), (0.9, RED, 0.9), (0.2, GREEN, 0.3)).ripeness is RED


def test_a_fruit_on_the_border_gets_one_verdict_from_all_its_looks() -> None:
    """A policy that leaves green fruit; scores within noise of the border between green and turning."""
    policy = Policy(ripeness=frozenset({TURNING, RED}))
    rng = np.random.default_rng(5)
    flips_by_look = 0
    for _ in range(200):
        book, verdicts, plain = Book(), [], []
        for frame in range(6):
            score = float(np.clip(0.25 + rng.normal(0.0, 0.04), 0.0, 1.0))
            kind = TURNING if score >= 0.25 else GREEN
            book, _ = observe(book, [seen(0.5, ripeness=kind, score=score)], float(frame), PARAMETERS)
            verdicts.append(wanted(book.targets[0], policy).wanted)
            plain.append(kind)
        assert len(set(verdicts)) == 1
        flips_by_look += len(set(plain)) > 1
    assert flips_by_look > 150  # each look for itself would have said this and that


def test_a_fruit_that_proves_to_be_of_another_ripeness_changes_its_verdict() -> None:
    policy = Policy(ripeness=frozenset({RED}))
    assert not wanted(looked_at((0.6, TURNING, 0.5)), policy).wanted
    assert wanted(looked_at((0.6, TURNING, 0.5), (0.95, RED, 0.95), (0.96, RED, 0.95)), policy).wanted


def test_a_score_that_is_no_number_is_refused() -> None:
    with pytest.raises(ValueError, match="sighting 0"):
        observe(Book(), [seen(0.5, score=float("nan"))], 0.0, PARAMETERS)


@pytest.mark.parametrize(
    "wrong", [{"turning_from": 0.05}, {"red_from": 0.95}, {"turning_from": 0.7}, {"band": 0.0}, {"band": float("nan")}]
)
def test_borders_that_leave_a_class_no_room_are_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(ValueError, match="turning_from"):
        RipenessBorders(**wrong)

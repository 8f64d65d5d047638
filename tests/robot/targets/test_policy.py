from dataclasses import replace

import pytest

from robot.targets import Book, BookParameters, Policy, TargetState, observe, wanted

from .fruit import seen

POLICY = Policy(sure_confidence=0.95)


def _target(confidence: float, frames: int):
    book = Book()
    for frame in range(frames):
        book, _ = observe(book, [seen(0.5, confidence=confidence)], float(frame), BookParameters())
    (target,) = book.targets
    return target


def test_a_fruit_that_was_seen_once_and_not_surely_waits_for_a_second_look():
    verdict = wanted(_target(0.8, frames=1), POLICY)
    assert not verdict.wanted
    assert verdict.state is TargetState.DOUBTFUL
    assert verdict.reason == "seen once, with confidence 0.80 below 0.95"


@pytest.mark.parametrize(("confidence", "frames"), [(0.96, 1), (0.8, 2)])
def test_a_sure_look_or_a_second_one_is_enough(confidence, frames):
    assert wanted(_target(confidence, frames), POLICY).wanted


def test_a_second_look_does_not_lift_the_least_confidence():
    assert not wanted(_target(0.4, frames=2), POLICY).wanted


@pytest.mark.parametrize("value", [-0.1, 1.1, float("nan")])
def test_a_confidence_outside_its_range_is_refused(value):
    with pytest.raises(ValueError, match="sure_confidence"):
        replace(POLICY, sure_confidence=value)

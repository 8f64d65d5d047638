"""A fruit too hidden to measure: its size is an estimate until a look measures it."""

from __future__ import annotations

import pytest

from robot.targets import Book, BookParameters, Policy, Target, TargetState, observe, wanted
from tests.robot.targets.fruit import seen

PARAMETERS = BookParameters()
HIDDEN = {"measured": False, "diameter_sigma_m": 0.012}


def after(*looks: dict[str, object]) -> Target:
    book = Book()
    for frame, look in enumerate(looks):
        book, _ = observe(book, [seen(0.5, **look)], float(frame), PARAMETERS)  # type: ignore[arg-type]
    (target,) = book.targets
    return target


def test_a_target_is_measured_when_any_look_measured_it() -> None:
    assert not after(HIDDEN, HIDDEN).measured
    assert after(HIDDEN, {}, HIDDEN).measured


def test_a_measured_look_replaces_the_estimate() -> None:
    target = after({"diameter_m": 0.06, **HIDDEN}, {"diameter_m": 0.075})
    assert (target.diameter_m, target.diameter_sigma_m) == (0.075, 0.003)


def test_an_estimate_does_not_move_a_measured_size() -> None:
    target = after({"diameter_m": 0.075}, {"diameter_m": 0.06, **HIDDEN})
    assert (target.diameter_m, target.diameter_sigma_m, target.sightings) == (0.075, 0.003, 2)


def test_of_two_measured_looks_the_surer_weighs_more() -> None:
    looks = [{"diameter_m": 0.070, "diameter_sigma_m": 0.001}, {"diameter_m": 0.076, "diameter_sigma_m": 0.006}]
    variances = [sigma_m**2 + PARAMETERS.diameter_floor_m**2 for sigma_m in (0.001, 0.006)]
    expected_m = 0.070 + 0.006 * variances[0] / sum(variances)
    assert after(*looks).diameter_m == pytest.approx(expected_m)
    assert after(*reversed(looks)).diameter_m == pytest.approx(expected_m)


def test_estimates_are_averaged_but_no_surer_for_being_many() -> None:
    looks = [{"diameter_m": d, **HIDDEN} for d in (0.062, 0.070, 0.066)]
    target = after(*looks)
    assert 0.062 < target.diameter_m < 0.070
    assert target.diameter_sigma_m == 0.012


def test_whether_hidden_fruit_are_treated_is_the_policys() -> None:
    target = after(HIDDEN)
    assert wanted(target, Policy()).wanted
    verdict = wanted(target, Policy(treat_hidden=False))
    assert (verdict.wanted, verdict.state, verdict.reason) == (False, TargetState.DOUBTFUL, "too hidden to measure")
    assert wanted(after({}), Policy(treat_hidden=False)).wanted


@pytest.mark.parametrize(
    ("diameter_m", "hidden_state", "measured_state"),
    [
        (0.030, TargetState.OPEN, TargetState.NOT_WANTED),
        (0.020, TargetState.NOT_WANTED, TargetState.NOT_WANTED),
        (0.180, TargetState.OPEN, TargetState.NOT_WANTED),
        (0.190, TargetState.NOT_WANTED, TargetState.NOT_WANTED),
        (0.070, TargetState.OPEN, TargetState.OPEN),
    ],
)
def test_an_estimate_is_out_of_range_only_beyond_its_sigma(
    diameter_m: float, hidden_state: TargetState, measured_state: TargetState
) -> None:
    """Range 35 to 170 mm, sigma 12 mm."""
    assert wanted(after({"diameter_m": diameter_m, **HIDDEN}), Policy()).state is hidden_state
    assert wanted(after({"diameter_m": diameter_m}), Policy()).state is measured_state

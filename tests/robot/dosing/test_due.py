"""What a target is due: its size, its ripeness, and how well it was seen."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from robot.dosing import (
    Caps,
    DoseLaw,
    DoseRules,
    Due,
    FlowModel,
    Hidden,
    LawKind,
    PulseLimits,
    Refusal,
    RipenessFactors,
    plan,
)
from robot.dosing import due as due_of
from robot.targets import Target
from robot.vision.values import Ripeness
from tests.robot.ledger.rows import target

GREEN, TURNING, RED = Ripeness.GREEN, Ripeness.TURNING, Ripeness.RED
LAW = DoseLaw(LawKind.VOLUME, 0.02, 1.5, 12.0)
HALF_GREEN = RipenessFactors(red=1.0, turning=0.8, green=0.5)
FULL_ML = 0.02 * 268.0826  # a sphere of 80 mm


def fruit(kind: Ripeness = RED, score: float = 1.0, **changes: object) -> Target:
    """80 mm, sigma 3 mm."""
    return replace(target(), ripeness=kind, ripeness_score=score, **changes)  # type: ignore[arg-type]


def rules(hidden: Hidden = Hidden.MINIMUM, factors: RipenessFactors = HALF_GREEN) -> DoseRules:
    return DoseRules(LAW, factors, hidden)


def asked(one: Target, by: DoseRules) -> Due:
    found = due_of(one, by)
    assert isinstance(found, Due)
    return found


@pytest.mark.parametrize(
    ("kind", "score", "factor"), [(RED, 1.0, 1.0), (TURNING, 0.5, 0.8), (GREEN, 0.0, 0.5), (GREEN, 0.16, 0.5)]
)
def test_inside_a_class_its_factor_holds_exactly(kind: Ripeness, score: float, factor: float) -> None:
    found = asked(fruit(kind, score), rules())
    assert found == Due(pytest.approx(factor * FULL_ML, rel=1e-6), factor, "")  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("score", "factor"), [(0.171, 0.501875), (0.21, 0.575), (0.25, 0.65), (0.29, 0.725), (0.71, 0.85), (0.79, 0.95)]
)
def test_at_a_border_the_factor_goes_over_from_one_class_to_the_next(score: float, factor: float) -> None:
    kinds = (GREEN, TURNING) if score < 0.5 else (TURNING, RED)
    for kind in kinds:
        assert HALF_GREEN.at(kind, score) == pytest.approx(factor)


def test_beside_a_class_that_is_not_treated_the_factor_holds_to_the_end() -> None:
    only_ripe = replace(HALF_GREEN, green=0.0, treated=frozenset({RED, TURNING}))
    assert [only_ripe.at(TURNING, score) for score in (0.18, 0.25, 0.4)] == [0.8, 0.8, 0.8]


def test_a_fruit_that_is_not_treated_has_no_due() -> None:
    only_red = rules(factors=replace(HALF_GREEN, treated=frozenset({RED})))
    assert due_of(fruit(GREEN, 0.0), only_red) == Refusal("green fruit is not treated")
    assert (only_red.dose_ml(0.08, GREEN), only_red.dose_ml(0.08, RED)) == (0.0, pytest.approx(FULL_ML, rel=1e-6))


def test_a_hidden_fruit_is_skipped_or_gets_the_minimum_or_what_it_is_surely_due() -> None:
    hidden = fruit(GREEN, 0.0, measured=False, diameter_sigma_m=0.016)
    assert due_of(hidden, rules(Hidden.SKIP)) == Refusal("too hidden to measure")
    assert due_of(hidden, rules(Hidden.MINIMUM)) == Due(1.5, 1.0, "too hidden to measure: minimum dose")
    estimated = asked(hidden, rules(Hidden.ESTIMATE))
    assert estimated.ml == pytest.approx(0.5 * 0.8**3 * FULL_ML, rel=1e-6)
    assert estimated.basis == "too hidden to measure: dose of 64 mm, estimated 80 less a sigma"


@pytest.mark.parametrize("hidden", list(Hidden))
def test_a_measured_fruit_does_not_ask_the_policy(hidden: Hidden) -> None:
    assert due_of(fruit(), rules(hidden)) == asked(fruit(), rules())


def test_an_estimate_that_may_be_nothing_is_due_nothing_and_so_gets_the_minimum() -> None:
    vague = asked(fruit(measured=False, diameter_sigma_m=0.09), rules(Hidden.ESTIMATE))
    assert vague.ml == 0.0
    shot = plan(vague, LAW, FlowModel(12.6, 2.76, 0.025, 0.020), 2.76, PulseLimits(0.08, 2.0), Caps())
    assert not isinstance(shot, Refusal)
    assert (shot.dose_ml, shot.limit) == (1.5, "minimum dose")
    assert shot.reason == "too hidden to measure: dose of 0 mm, estimated 80 less a sigma; minimum dose"


def test_factors_do_not_lift_a_dose_over_maximum_and_caps() -> None:
    double = rules(factors=RipenessFactors(red=2.0))
    big = asked(fruit(diameter_m=0.11), double)
    assert big.ml > 24.0
    shot = plan(big, LAW, FlowModel(12.6, 2.76, 0.025, 0.020), 2.76, PulseLimits(0.08, 2.0), Caps(shot_ml=10.0))
    assert not isinstance(shot, Refusal)
    assert (shot.dose_ml, shot.factor, shot.reason) == (10.0, 2.0, "cap of a shot")
    assert double.dose_ml(0.11, RED) == 12.0


@pytest.mark.parametrize(
    ("diameter_m", "sigma_m"), [(0.0, 0.003), (-0.1, 0.003), (math.nan, 0.003), (0.08, math.nan), (0.08, -1.0)]
)
def test_a_fruit_without_a_size_is_refused(diameter_m: float, sigma_m: float) -> None:
    found = due_of(fruit(diameter_m=diameter_m, diameter_sigma_m=sigma_m), rules())
    assert isinstance(found, Refusal)
    assert "no usable diameter" in found.reason


@pytest.mark.parametrize(
    ("wrong", "words"),
    [({"green": 2.1}, "0..2, found 2.1 for green"), ({"red": float("nan")}, "0..2"), ({"turning": 0.0}, "factor of 0")],
)
def test_impossible_factors_are_refused(wrong: dict[str, float], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        RipenessFactors(**wrong)

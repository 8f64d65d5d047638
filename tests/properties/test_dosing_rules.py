"""Properties of the rules: monotone in size, steady in a noisy score, never over a cap whatever was seen."""

from __future__ import annotations

from dataclasses import replace

from hypothesis import assume, given
from hypothesis import strategies as st

from robot.dosing import (
    Caps,
    DoseLaw,
    DoseRules,
    FlowModel,
    Hidden,
    LawKind,
    PulseLimits,
    Refusal,
    RipenessFactors,
    plan,
)
from robot.dosing import due as due_of
from robot.targets import RipenessBorders, Target, classify
from robot.vision.values import Ripeness
from tests.robot.ledger.rows import target

FLOW, PULSES = FlowModel(12.6, 2.76, 0.025, 0.020), PulseLimits(0.08, 2.0)
BORDERS = RipenessBorders()
factor = st.floats(0.05, 2.0)
scores = st.floats(0.0, 1.0)
diameters = st.floats(0.02, 0.2)
kinds = st.sampled_from(Ripeness)
rules = st.builds(
    lambda kind, coefficient, low, span, factors, hidden: DoseRules(
        DoseLaw(kind, coefficient, low, low + span), RipenessFactors(*factors), hidden
    ),
    st.sampled_from(LawKind),
    st.floats(1e-3, 2.0),
    st.floats(1.0, 5.0),
    st.floats(0.0, 20.0),
    st.tuples(factor, factor, factor),
    st.sampled_from(Hidden),
)


def seen(diameter_m: float, score: float, held: Ripeness, measured: bool, sigma_m: float = 0.01) -> Target:
    return replace(
        target(),
        diameter_m=diameter_m,
        diameter_sigma_m=sigma_m,
        ripeness=classify(score, held, BORDERS),
        ripeness_score=score,
        measured=measured,
    )


def given_ml(one: Target, by: DoseRules, caps: Caps) -> float:
    """What the shot would give; 0 for a fruit that is refused."""
    due = due_of(one, by)
    if isinstance(due, Refusal):
        return 0.0
    shot = plan(due, by.law, FLOW, 2.76, PULSES, caps)
    return 0.0 if isinstance(shot, Refusal) else sum(FLOW.volume_ml(open_s, 2.76) for open_s in shot.open_s)


@given(diameters, diameters, scores, kinds, st.booleans(), rules)
def test_a_bigger_fruit_of_the_same_ripeness_never_gets_less(
    a: float, b: float, score: float, held: Ripeness, measured: bool, by: DoseRules
) -> None:
    small, big = (given_ml(seen(d, score, held, measured), by, Caps()) for d in (min(a, b), max(a, b)))
    assert small <= big + 1e-9


fruits = st.builds(seen, diameters, scores, kinds, st.booleans(), st.floats(0.0, 0.3))


@given(fruits, rules, st.floats(1.0, 20.0), st.floats(0.0, 20.0))
def test_no_ripeness_no_policy_and_no_size_passes_a_cap(
    fruit: Target, by: DoseRules, cap_ml: float, left_ml: float
) -> None:
    ml = given_ml(fruit, by, Caps(cap_ml, (("label cap", left_ml),)))
    assert ml <= min(by.law.max_ml, cap_ml, left_ml) + 1e-6


@given(diameters, scores, kinds, st.floats(0.0, 0.1), rules)
def test_a_hidden_fruit_never_gets_more_than_if_its_estimate_were_measured(
    diameter_m: float, score: float, held: Ripeness, sigma_m: float, by: DoseRules
) -> None:
    hidden, measured = (given_ml(seen(diameter_m, score, held, m, sigma_m), by, Caps()) for m in (False, True))
    assert hidden <= measured + 1e-9


@given(scores, st.floats(-0.01, 0.01), kinds, kinds, st.tuples(factor, factor, factor))
def test_a_little_noise_in_the_score_changes_the_dose_a_little_whatever_class_was_held(
    score: float, noise: float, held: Ripeness, other: Ripeness, values: tuple[float, float, float]
) -> None:
    factors = RipenessFactors(*values)
    moved = score + noise
    assume(0.0 <= moved <= 1.0)
    before = factors.at(classify(score, held, BORDERS), score)
    after = factors.at(classify(moved, other, BORDERS), moved)
    steepest = max(abs(values[0] - values[1]), abs(values[1] - values[2])) / (2.0 * BORDERS.band)
    assert abs(after - before) <= steepest * abs(noise) + 1e-9


@given(scores, kinds, st.tuples(factor, factor, factor))
def test_a_factor_lies_between_those_of_the_classes(
    score: float, held: Ripeness, values: tuple[float, float, float]
) -> None:
    found = RipenessFactors(*values).at(classify(score, held, BORDERS), score)
    assert min(values) - 1e-9 <= found <= max(values) + 1e-9

"""F65, F66: commanded against measured, on one shot and over ten; the tank by the ledger and by its level."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robot.dosing import FlowHistory, ShotFlow, tank_problem
from robot.dosing.flow_check import OVER_SHOTS, many_shots_problem, one_shot_problem

PULSE_ML = 0.17


def history(*shots: tuple[float, float], resolution_ml: float = PULSE_ML) -> FlowHistory:
    found = FlowHistory(resolution_ml)
    for model_ml, measured_ml in shots:
        found = found.with_shot(model_ml, measured_ml)
    return found


def test_an_empty_history_complains_of_nothing() -> None:
    assert history().problem == ""
    assert not history().dry


@pytest.mark.parametrize(
    ("measured_ml", "words"),
    [
        (10.0, ""),
        (7.0, ""),
        (6.84, ""),  # one pulse of the meter is not held against it
        (6.82, r"saw 6.82 of 10.00 ml (68 %): check nozzle, filter and meter"),
        (13.0, ""),
        (13.16, ""),
        (13.18, "saw 13.18 of 10.00 ml (132 %): check nozzle (worn or gone)"),
    ],
)
def test_one_shot_far_off_its_model_asks_for_the_nozzle(measured_ml: float, words: str) -> None:
    assert words in history((10.0, measured_ml)).problem
    assert bool(history((10.0, measured_ml)).problem) == bool(words)


@pytest.mark.parametrize(("share", "fine"), [(1.14, True), (0.86, True), (1.16, False), (0.84, False)])
def test_ten_shots_that_are_off_together_ask_for_it_too(share: float, fine: bool) -> None:
    shots = [(4.0, 4.0 * share)] * OVER_SHOTS
    assert history(*shots[:-1], resolution_ml=0.0).problem == ""
    assert (history(*shots, resolution_ml=0.0).problem == "") is fine
    if not fine:
        assert "over 10 shots the flow meter saw" in history(*shots).problem


def test_only_the_last_ten_count() -> None:
    old = [(4.0, 3.0)] * 20
    assert history(*old, *[(4.0, 4.0)] * OVER_SHOTS).problem == ""
    assert len(history(*old).shots) == OVER_SHOTS


def test_a_shot_of_less_than_half_is_drawn_from_a_dry_tank() -> None:
    assert history((10.0, 4.8)).dry
    assert not history((10.0, 4.9)).dry
    assert not history((10.0, 0.0), (10.0, 10.0)).dry


def test_a_shot_of_which_nothing_was_expected_is_refused() -> None:
    for wrong in (0.0, -1.0, float("nan")):
        with pytest.raises(ValueError, match="more than 0 ml"):
            history((wrong, 1.0))


@pytest.mark.parametrize(
    ("balance_ml", "level_ml", "words"),
    [
        (500.0, 500.0, ""),
        (200.0, 200.0, ""),
        (199.0, 500.0, "by the ledger the tank holds 199 ml (reserve 200): refill"),
        (500.0, 199.0, "the tank's level reads 199 ml (reserve 200): refill"),
        (float("nan"), 500.0, "by the ledger"),
        (500.0, float("nan"), "level reads"),
    ],
)
def test_the_tank_is_empty_by_the_ledger_or_by_its_level(balance_ml: float, level_ml: float, words: str) -> None:
    assert words in tank_problem(balance_ml, level_ml, 200.0)
    assert bool(tank_problem(balance_ml, level_ml, 200.0)) == bool(words)


ml = st.floats(0.1, 50.0)
shots = st.lists(st.builds(ShotFlow, model_ml=ml, measured_ml=st.floats(0.0, 80.0)), max_size=25)


@given(shots)
def test_the_history_says_what_its_last_ten_shots_say(many: list[ShotFlow]) -> None:
    found = history(*[(shot.model_ml, shot.measured_ml) for shot in many])
    last = many[-OVER_SHOTS:]
    assert found.shots == tuple(last)
    assert (found.problem == "") == (not one_shot_problem(last, PULSE_ML) and not many_shots_problem(last, PULSE_ML))


@given(st.lists(st.tuples(ml, st.floats(0.86, 1.14)), max_size=30))
def test_a_machine_within_its_tolerance_is_never_complained_of(many: list[tuple[float, float]]) -> None:
    found = FlowHistory(PULSE_ML)
    for model_ml, share in many:
        found = found.with_shot(model_ml, share * model_ml)
        assert found.problem == ""


@given(st.lists(ml, min_size=OVER_SHOTS, max_size=30), st.one_of(st.floats(0.0, 0.6), st.floats(1.4, 3.0)))
def test_a_nozzle_that_is_far_off_is_found_by_the_tenth_shot(models_ml: list[float], share: float) -> None:
    found = history(*[(model_ml, share * model_ml) for model_ml in models_ml], resolution_ml=0.01)
    assert found.problem


@given(ml, st.floats(0.0, 80.0), st.floats(0.0, 80.0))
def test_a_shot_further_from_its_model_is_never_judged_better(model_ml: float, a_ml: float, b_ml: float) -> None:
    near, far = sorted((a_ml, b_ml), key=lambda measured_ml: abs(measured_ml - model_ml))
    same_side = (near - model_ml) * (far - model_ml) >= 0
    if same_side and one_shot_problem([ShotFlow(model_ml, near)], PULSE_ML):
        assert one_shot_problem([ShotFlow(model_ml, far)], PULSE_ML)

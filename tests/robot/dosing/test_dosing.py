"""Size to millilitres to valve time, with minimum, maximum, caps and the valve's own limits."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from robot.dosing import Caps, DoseLaw, Due, FlowModel, LawKind, PulseLimits, Refusal, Shot, fit_flow, plan

LAW = DoseLaw(LawKind.VOLUME, 0.02, 1.5, 12.0)
FLOW = FlowModel(12.6, 2.76, 0.025, 0.020)
PULSES = PulseLimits(0.08, 2.0)


def shot(diameter_m: float, pressure_bar: float = 2.76, law: DoseLaw = LAW, caps: Caps | None = None) -> Shot:
    planned = plan(Due(law.due_ml(diameter_m)), law, FLOW, pressure_bar, PULSES, caps or Caps())
    assert isinstance(planned, Shot)
    return planned


def refusal(diameter_m: float, **changes: object) -> str:
    arguments: dict[str, Any] = {
        "law": LAW,
        "flow": FLOW,
        "pressure_bar": 2.76,
        "pulses": PULSES,
        "caps": Caps(),
        **changes,
    }
    planned = plan(Due(arguments["law"].due_ml(diameter_m)), **arguments)
    assert isinstance(planned, Refusal)
    return planned.reason


def test_a_fruit_of_8_cm_is_due_its_volume_times_the_coefficient() -> None:
    assert shot(0.08).due_ml == pytest.approx(0.02 * 268.08, rel=1e-4)


def test_double_the_diameter_is_due_eight_times_by_volume_four_times_by_area_once_when_fixed() -> None:
    for kind, factor in ((LawKind.VOLUME, 8.0), (LawKind.AREA, 4.0), (LawKind.FIXED, 1.0)):
        law = DoseLaw(kind, 0.01, 0.001, 100.0)
        assert law.due_ml(0.1) / law.due_ml(0.05) == pytest.approx(factor)


def test_the_laws_dose_is_its_due_inside_minimum_and_maximum() -> None:
    assert [LAW.dose_ml(d) for d in (0.03, 0.08, 0.2)] == [1.5, pytest.approx(LAW.due_ml(0.08)), 12.0]


def test_area_law_counts_the_surface_of_the_sphere() -> None:
    assert DoseLaw(LawKind.AREA, 0.05, 0.1, 50.0).due_ml(0.07) == pytest.approx(0.05 * math.pi * 49.0)


def test_coil_time_gives_back_the_dose_through_the_flow_model() -> None:
    planned = shot(0.09)
    assert sum(FLOW.volume_ml(t, 2.76) for t in planned.open_s) == pytest.approx(planned.dose_ml)


def test_latencies_add_their_difference_to_the_coil_time() -> None:
    assert FLOW.open_s(12.6, 2.76) == pytest.approx(1.0 + 0.025 - 0.020)


def test_flow_follows_the_root_of_the_pressure() -> None:
    assert FLOW.flow_at(4 * 2.76) == pytest.approx(2 * 12.6)
    assert shot(0.09, pressure_bar=1.38).open_s[0] > shot(0.09).open_s[0]


def test_a_coil_that_was_never_on_gives_nothing() -> None:
    slow_to_close = FlowModel(12.6, 2.76, 0.0, 0.05)
    assert slow_to_close.volume_ml(0.0, 2.76) == 0.0
    assert slow_to_close.open_s(0.0, 2.76) == 0.0


def test_a_small_fruit_gets_the_minimum_and_says_so() -> None:
    planned = shot(0.04)
    assert (planned.dose_ml, planned.limit) == (1.5, "minimum dose")
    assert planned.due_ml < 1.5


def test_a_huge_fruit_gets_the_maximum_and_says_so() -> None:
    assert (shot(0.14).dose_ml, shot(0.14).limit) == (12.0, "maximum dose")


def test_the_cap_of_a_shot_wins_over_the_law() -> None:
    planned = shot(0.09, caps=Caps(shot_ml=5.0))
    assert (planned.dose_ml, planned.limit) == (5.0, "cap of a shot")


def test_a_fruit_inside_all_limits_names_none() -> None:
    assert shot(0.08).limit == ""


def test_a_cap_that_takes_back_what_the_minimum_added_leaves_the_due_dose_unchanged() -> None:
    law = DoseLaw(LawKind.FIXED, 1.2, 1.5, 12.0)
    planned = shot(0.08, law=law, caps=Caps(shot_ml=1.2))
    assert (planned.due_ml, planned.dose_ml, planned.limit) == (1.2, 1.2, "")


def test_a_total_with_too_little_left_refuses_the_whole_dose() -> None:
    assert refusal(0.09, caps=Caps(left_ml=(("label cap", 100.0), ("tank", 3.0)))) == "tank: 3.0 ml left, 7.6 ml due"


def test_a_dose_longer_than_one_opening_is_split_equally() -> None:
    planned = plan(Due(LAW.due_ml(0.14)), LAW, FLOW, 2.76, PulseLimits(0.08, 0.4), Caps())
    assert isinstance(planned, Shot)
    assert len(planned.open_s) == 3
    assert len(set(planned.open_s)) == 1
    assert max(planned.open_s) <= 0.4
    assert sum(FLOW.volume_ml(t, 2.76) for t in planned.open_s) == pytest.approx(12.0)


def test_a_dose_below_the_shortest_pulse_is_refused_with_the_figures() -> None:
    law = DoseLaw(LawKind.FIXED, 0.5, 0.1, 12.0)
    assert refusal(0.08, law=law) == "0.50 ml cannot be given: a pulse of 0.080 to 2.000 s gives 0.94 to 25.14 ml"


def test_parts_below_the_shortest_pulse_are_refused() -> None:
    law = DoseLaw(LawKind.FIXED, 1.2, 0.1, 12.0)
    assert "cannot be given" in refusal(0.08, law=law, pulses=PulseLimits(0.08, 0.09))


def test_a_valve_that_never_opens_in_time_is_refused() -> None:
    sluggish = FlowModel(12.6, 2.76, 0.9, 0.0)
    assert "cannot be given" in refusal(0.08, flow=sluggish, pulses=PulseLimits(0.08, 0.5))


@pytest.mark.parametrize("ml", [-0.1, float("nan"), float("inf")])
def test_a_due_that_is_no_amount_is_refused(ml: float) -> None:
    planned = plan(Due(ml), LAW, FLOW, 2.76, PULSES, Caps())
    assert isinstance(planned, Refusal)
    assert "no amount" in planned.reason


@pytest.mark.parametrize("pressure_bar", [0.0, -1.0, float("nan")])
def test_no_pressure_no_dose(pressure_bar: float) -> None:
    assert "no pressure" in refusal(0.08, pressure_bar=pressure_bar)


def test_a_cap_that_is_not_a_number_refuses() -> None:
    assert refusal(0.08, caps=Caps(left_ml=(("tank", float("nan")),))).startswith("tank")


@pytest.mark.parametrize(
    ("coefficient", "min_ml", "max_ml"), [(0.0, 1.0, 2.0), (0.02, 3.0, 2.0), (float("nan"), 1.0, 2.0), (0.02, 0.0, 2.0)]
)
def test_an_impossible_law_is_refused(coefficient: float, min_ml: float, max_ml: float) -> None:
    with pytest.raises(ValueError):
        DoseLaw(LawKind.VOLUME, coefficient, min_ml, max_ml)


@pytest.mark.parametrize("figures", [(0.0, 2.76, 0.02, 0.02), (12.6, 0.0, 0.02, 0.02), (12.6, 2.76, -0.1, 0.02)])
def test_an_impossible_flow_model_is_refused(figures: tuple[float, float, float, float]) -> None:
    with pytest.raises(ValueError):
        FlowModel(*figures)


def test_impossible_pulse_limits_are_refused() -> None:
    with pytest.raises(ValueError):
        PulseLimits(0.5, 0.1)


def test_flow_without_pressure_is_an_error() -> None:
    with pytest.raises(ValueError, match="positive pressure"):
        FLOW.flow_at(0.0)


def test_a_catch_test_gives_back_the_valve_it_was_made_with() -> None:
    true = FlowModel(13.1, 2.76, 0.031, 0.020)
    times = [0.15, 0.15, 0.3, 0.3, 0.6, 0.6, 1.2, 1.2]
    noise = np.random.default_rng(2).normal(0.0, 0.05, len(times))
    fitted = fit_flow(times, [true.volume_ml(t, 2.76) + n for t, n in zip(times, noise, strict=True)], 2.76)
    assert fitted.model.flow_ml_s == pytest.approx(13.1, rel=0.02)
    assert fitted.model.open_latency_s == pytest.approx(0.031, abs=0.008)
    assert abs(fitted.model.flow_ml_s - 13.1) < 4 * fitted.flow_sigma_ml_s
    assert abs(fitted.dead_time_s - 0.011) < 4 * fitted.dead_time_sigma_s
    assert fitted.rms_ml < 0.1
    assert sum(fitted.residual_ml) == pytest.approx(0.0, abs=1e-9)


def test_a_valve_that_closes_slower_than_it_opens_has_a_negative_dead_time() -> None:
    fitted = fit_flow([0.2, 0.5, 1.0], [10 * (t + 0.03) for t in (0.2, 0.5, 1.0)], 2.76, close_latency_s=0.02)
    assert fitted.dead_time_s == pytest.approx(-0.03)
    assert fitted.model.open_latency_s == 0.0
    assert fitted.model.volume_ml(0.5, 2.76) == pytest.approx(5.3)


@pytest.mark.parametrize(
    ("open_s", "ml", "words"),
    [
        ([0.2, 0.5], [2.0, 5.0], "at least 3 pulses"),
        ([0.2, 0.5, 1.0], [2.0, 5.0], "at least 3 pulses"),
        ([0.2, 0.5, 1.0], [2.0, float("nan"), 9.0], "positive and finite"),
        ([0.2, 0.5, 1.0], [2.0, 0.0, 9.0], "leave out empty catches"),
        ([0.5, 0.5, 0.5], [5.0, 5.1, 5.0], "same length"),
        ([0.2, 0.5, 1.0], [9.0, 5.0, 2.0], "did not give more"),
    ],
)
def test_a_catch_test_that_tells_nothing_is_refused(open_s: list[float], ml: list[float], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        fit_flow(open_s, ml, 2.76)

import math
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robot.dosing import Catch, fit_catches, meter_ml_per_pulse

LENGTHS_S = (0.1, 0.35, 0.6, 0.85, 1.1)
BAR = 2.76


def cups(flow_ml_s: float = 12.6, dead_s: float = 0.005, pulses: int = 5, pressure_bar: float = BAR) -> list[Catch]:
    """What an exact nozzle gives, with the flow stated at 2.76 bar."""
    flow = flow_ml_s * math.sqrt(pressure_bar / BAR)
    return [Catch(each_s, pulses, pulses * flow * (each_s - dead_s), pressure_bar) for each_s in LENGTHS_S]


@given(
    flow=st.floats(1.0, 100.0), dead_s=st.floats(-0.05, 0.08), pulses=st.integers(1, 20), pressure=st.floats(1.5, 4.0)
)
def test_an_exact_nozzle_is_found_whatever_the_pressure_of_the_test(flow, dead_s, pulses, pressure):
    fit = fit_catches(cups(flow, dead_s, pulses, pressure), BAR, 0.02)
    assert fit.flow.model.flow_ml_s == pytest.approx(flow)
    assert fit.flow.dead_time_s == pytest.approx(dead_s, abs=1e-9)
    assert fit.flow.model.open_latency_s - fit.flow.model.close_latency_s == pytest.approx(dead_s, abs=1e-9)
    assert fit.r2 == pytest.approx(1.0)


def test_cups_may_come_in_any_order():
    assert fit_catches(cups()[::-1], BAR, 0.02).flow.model.flow_ml_s == pytest.approx(12.6)


@pytest.mark.parametrize("place", range(5))
@pytest.mark.parametrize("off_ml", [-0.9, 0.9])
def test_the_cup_that_does_not_lie_on_the_line_is_named(place, off_ml):
    caught = cups()
    caught[place] = replace(caught[place], caught_ml=caught[place].caught_ml + 5 * off_ml * (1 + 2 * (place > 2)))
    with pytest.raises(ValueError, match=rf"the cup of 5 x {LENGTHS_S[place]:.3f} s lies .* catch it again"):
        fit_catches(caught, BAR, 0.02)


def test_a_longer_pulse_that_gave_less_is_told():
    caught = cups()
    caught[3] = replace(caught[3], caught_ml=20.0)
    with pytest.raises(ValueError, match=r"longer pulses did not always give more: the cup of 5 x 0\.850 s"):
        fit_catches(caught, BAR, 0.02)


def test_a_scale_that_rounds_to_a_gram_is_good_enough():
    caught = [replace(cup, caught_ml=round(cup.caught_ml)) for cup in cups()]
    fit = fit_catches(caught, BAR, 0.02)
    assert fit.flow.model.flow_ml_s == pytest.approx(12.6, rel=0.02)


@pytest.mark.parametrize(
    ("caught", "words"),
    [
        (cups()[:3], "needs 4 pulse lengths or more, found 3"),
        (cups()[:1] * 5, "needs 4 pulse lengths or more, found 1"),
        ([*cups()[:4], replace(cups()[4], caught_ml=0.0)], "the cup of 5 x 1.100 s: expected millilitres"),
        ([*cups()[:4], replace(cups()[4], caught_ml=math.nan)], "the cup of 5 x 1.100 s: expected millilitres"),
        ([replace(cup, caught_ml=10.0) for cup in cups()], "longer pulses did not"),
        (cups(dead_s=-0.3), "a dead time of -0.300 s is not plausible"),
        (cups(dead_s=0.05, flow_ml_s=12600.0), "a flow of 1.26e\\+04 ml/s is not plausible"),
        ([replace(cup, pulses=5, caught_ml=2 * cup.caught_ml + 30.0) for cup in cups()], "a dead time of -0"),
    ],
)
def test_what_cannot_be_a_calibration_is_refused(caught, words):
    with pytest.raises(ValueError, match=words):
        fit_catches(caught, BAR, 0.02)


def test_the_meters_pulse_follows_from_what_was_caught():
    caught = [replace(cup, counted_ml=1.25 * cup.caught_ml) for cup in cups()]
    assert meter_ml_per_pulse(caught, 0.17) == pytest.approx(0.17 / 1.25)
    assert meter_ml_per_pulse(cups(), 0.17) is None

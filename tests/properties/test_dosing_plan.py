"""Properties of the dose: never above a cap, and what is commanded is what comes out."""

from __future__ import annotations

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from robot.dosing import Caps, DoseLaw, Due, FlowModel, LawKind, PulseLimits, Shot, plan

flows = st.builds(
    FlowModel,
    flow_ml_s=st.floats(1.0, 60.0),
    pressure_bar=st.floats(1.0, 6.0),
    open_latency_s=st.floats(0.0, 0.08),
    close_latency_s=st.floats(0.0, 0.08),
)
pressures = st.floats(0.5, 10.0)
laws = st.builds(
    lambda kind, coefficient, low, span: DoseLaw(kind, coefficient, low, low + span),
    st.sampled_from(list(LawKind)),
    st.floats(1e-3, 5.0),
    st.floats(0.1, 5.0),
    st.floats(0.0, 30.0),
)
limits = st.builds(lambda low, span: PulseLimits(low, low + span), st.floats(0.02, 0.3), st.floats(0.01, 4.0))
caps = st.builds(
    lambda shot_ml, left_ml: Caps(shot_ml, (("label cap", left_ml),)), st.floats(0.5, 30.0), st.floats(0.0, 40.0)
)


@given(flows, pressures, st.floats(0.01, 50.0))
def test_millilitres_to_seconds_and_back_is_the_same(flow: FlowModel, pressure_bar: float, ml: float) -> None:
    open_s = flow.open_s(ml, pressure_bar)
    assume(open_s > 0.0)
    assert flow.volume_ml(open_s, pressure_bar) == pytest.approx(ml, rel=1e-9)


@given(flows, pressures, st.floats(0.0, 3.0), st.floats(0.0, 3.0))
def test_a_longer_opening_never_gives_less(flow: FlowModel, pressure_bar: float, a: float, b: float) -> None:
    assert flow.volume_ml(min(a, b), pressure_bar) <= flow.volume_ml(max(a, b), pressure_bar)


@given(st.floats(0.01, 0.3), laws, flows, pressures, limits, caps)
def test_a_shot_keeps_every_limit_and_gives_its_dose(
    diameter_m: float, law: DoseLaw, flow: FlowModel, pressure_bar: float, pulses: PulseLimits, cap: Caps
) -> None:
    planned = plan(Due(law.due_ml(diameter_m)), law, flow, pressure_bar, pulses, cap)
    assume(isinstance(planned, Shot))
    assert isinstance(planned, Shot)
    given_ml = sum(flow.volume_ml(t, pressure_bar) for t in planned.open_s)
    assert given_ml == pytest.approx(planned.dose_ml, rel=1e-6)
    assert planned.dose_ml <= min(law.max_ml, cap.shot_ml, cap.left_ml[0][1])
    assert planned.dose_ml >= min(law.min_ml, cap.shot_ml)
    assert all(pulses.min_s <= t <= pulses.max_s for t in planned.open_s)
    assert (planned.limit == "") == (planned.dose_ml == planned.due_ml)


@given(st.floats(0.02, 0.2), st.floats(0.02, 0.2), laws)
def test_a_bigger_fruit_is_never_due_less(a: float, b: float, law: DoseLaw) -> None:
    assert law.due_ml(min(a, b)) <= law.due_ml(max(a, b))

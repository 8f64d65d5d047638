"""Pump, valve and tank."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.twin import Verb, draw, exact
from drivers.twin.hydraulics import Hydraulics
from tests.drivers.twin import rig

NOMINAL = rig.nominal()


def fresh(pressed: bool = True) -> Hydraulics:
    """At time 0; ``pressed``: the pump has run for a long time."""
    hydraulics = Hydraulics(NOMINAL, exact(NOMINAL))
    hydraulics.set_pump(-1000.0, pressed)
    return hydraulics


def run(hydraulics: Hydraulics, until_s: float) -> None:
    while hydraulics.next_s <= until_s:
        hydraulics.step(hydraulics.next_s)


def shoot(hydraulics: Hydraulics, open_s: float, at_s: float = 0.0) -> float:
    """Millilitres of one opening."""
    before_ml = hydraulics.dispensed_ml(at_s)
    run(hydraulics, at_s)
    hydraulics.set_valve_coil(at_s, True)
    run(hydraulics, at_s + open_s)
    hydraulics.set_valve_coil(at_s + open_s, False)
    run(hydraulics, at_s + open_s + 1.0)
    return hydraulics.dispensed_ml(at_s + open_s + 1.0) - before_ml


@given(open_s=st.floats(0.03, 3.0))
def test_a_shot_at_full_pressure_gives_flow_times_open_time_less_the_latencies(open_s: float) -> None:
    expected_ml = NOMINAL.nozzle_flow_ml_s * (open_s - NOMINAL.valve_open_s + NOMINAL.valve_close_s)
    assert shoot(fresh(), open_s) == pytest.approx(expected_ml, rel=1e-9)


def test_a_pulse_shorter_than_the_latencies_gives_nothing() -> None:
    assert shoot(fresh(), NOMINAL.valve_open_s - NOMINAL.valve_close_s - 0.001) == 0.0


def test_pressure_builds_up_with_the_pumps_time_constant() -> None:
    hydraulics = fresh(pressed=False)
    hydraulics.set_pump(0.0, True)
    expected_bar = NOMINAL.pump_pressure_bar * (1.0 - math.exp(-1.0))
    assert hydraulics.pressure_bar(NOMINAL.pump_rise_s) == pytest.approx(expected_bar)


def test_flow_follows_the_root_of_pressure_while_it_builds_up() -> None:
    hydraulics = fresh(pressed=False)
    hydraulics.set_pump(0.0, True)
    run(hydraulics, 0.3)
    hydraulics.set_valve_coil(0.3, True)
    run(hydraulics, 0.9)
    steps = 200_000
    begin_s = 0.3 + NOMINAL.valve_open_s
    width_s = (0.9 - begin_s) / steps
    relief, rise = NOMINAL.pump_pressure_bar, NOMINAL.pump_rise_s
    expected_ml = sum(
        NOMINAL.nozzle_flow_ml_s
        * math.sqrt(relief * (1.0 - math.exp(-(begin_s + (k + 0.5) * width_s) / rise)) / NOMINAL.nozzle_pressure_bar)
        * width_s
        for k in range(steps)
    )
    assert hydraulics.dispensed_ml(0.9) == pytest.approx(expected_ml, rel=1e-7)


def test_the_tank_loses_what_leaves_the_nozzle() -> None:
    hydraulics = fresh()
    ml = shoot(hydraulics, 2.0)
    assert hydraulics.tank_ml == pytest.approx(NOMINAL.tank_fill_ml - ml, abs=1e-9)


def test_an_empty_tank_gives_nothing_more() -> None:
    hydraulics = fresh()
    hydraulics.refill(0.0, 5.0)
    assert shoot(hydraulics, 3.0) == pytest.approx(5.0)
    assert hydraulics.tank_ml == 0.0
    assert shoot(hydraulics, 3.0, at_s=10.0) == 0.0


def test_pressure_falls_faster_through_an_open_valve_once_the_pump_is_off() -> None:
    shut, open_ = fresh(), fresh()
    open_.set_valve_coil(-0.1, True)
    run(open_, 0.0)
    for hydraulics in (shut, open_):
        hydraulics.set_pump(0.0, False)
    run(open_, 0.5)
    assert open_.pressure_bar(0.5) < 0.2 * shut.pressure_bar(0.5)


@given(looks=st.lists(st.floats(0.0, 1.2), max_size=20))
def test_looking_at_the_meter_changes_nothing(looks: list[float]) -> None:
    watched, alone = fresh(), fresh()
    for hydraulics in (watched, alone):
        hydraulics.set_valve_coil(0.0, True)
    for look_s in sorted(looks):
        run(watched, look_s)
        watched.dispensed_ml(look_s)
    for hydraulics in (watched, alone):
        run(hydraulics, 1.3)
    assert watched.total_ml == alone.total_ml


def test_a_valve_that_is_off_does_not_open() -> None:
    hydraulics = fresh()
    hydraulics.set_valve_fault(-1.0, Verb.OFF)
    assert shoot(hydraulics, 1.0) == 0.0


def test_a_stuck_valve_flows_on_after_its_coil_is_off() -> None:
    hydraulics = fresh()
    hydraulics.set_valve_coil(0.0, True)
    run(hydraulics, 0.5)
    hydraulics.set_valve_fault(0.5, Verb.STUCK)
    hydraulics.set_valve_coil(1.0, False)
    run(hydraulics, 2.0)
    assert hydraulics.valve_open
    hydraulics.set_valve_fault(2.0, Verb.OK)
    run(hydraulics, 2.0)
    assert not hydraulics.valve_open


def test_a_leaking_valve_drips_under_pressure_while_shut() -> None:
    hydraulics = fresh()
    hydraulics.set_valve_fault(0.0, Verb.WRONG)
    run(hydraulics, 10.0)
    assert not hydraulics.valve_open
    assert 0.0 < hydraulics.dispensed_ml(10.0) < 0.05 * 10.0 * NOMINAL.nozzle_flow_ml_s


def test_a_slow_valve_opens_and_shuts_late() -> None:
    hydraulics = fresh()
    hydraulics.set_valve_fault(-1.0, Verb.SLOW)
    hydraulics.set_valve_coil(0.0, True)
    run(hydraulics, 0.24)
    assert not hydraulics.valve_open
    run(hydraulics, 0.26)
    assert hydraulics.valve_open


def test_the_true_nozzle_gives_its_own_flow() -> None:
    true = draw(NOMINAL, 3)
    hydraulics = Hydraulics(NOMINAL, true)
    hydraulics.set_pump(-1000.0, True)
    expected_ml = true.nozzle_flow_ml_s * (1.0 - true.valve_open_s + true.valve_close_s)
    assert shoot(hydraulics, 1.0) == pytest.approx(expected_ml)

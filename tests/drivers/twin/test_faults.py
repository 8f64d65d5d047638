"""Declared faults."""

from __future__ import annotations

import math

import pytest

from drivers.twin import Fault, FaultPlan, Verb, parse_fault


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("relay:garbage@12s+3s", Fault("relay", Verb.GARBAGE, 12.0, 3.0)),
        ("relay:garbage@12+3", Fault("relay", Verb.GARBAGE, 12.0, 3.0)),
        ("gps:off@1.5s", Fault("gps", Verb.OFF, 1.5, None)),
        ("camera:stuck", Fault("camera", Verb.STUCK, 0.0, None)),
        (" arm:slow+2s ", Fault("arm", Verb.SLOW, 0.0, 2.0)),
    ],
)
def test_a_fault_is_written_as_device_verb_start_duration(text: str, fault: Fault) -> None:
    assert parse_fault(text) == fault


@pytest.mark.parametrize("text", ["relay:garbage@12s+3s", "gps:off@0.1s", "arm:slow@1e-05s"])
def test_a_fault_prints_as_it_is_read(text: str) -> None:
    assert parse_fault(str(parse_fault(text))) == parse_fault(text)


@pytest.mark.parametrize(
    ("text", "known"),
    [
        ("laser:off", "camera"),
        ("relay:explode", "garbage"),
        ("valve:garbage", "stuck"),
        ("relay", "device:verb"),
        ("relay:off@soon", "device:verb"),
        ("relay:off@1.2.3", "seconds"),
        ("relay:off@1+0", "duration"),
    ],
)
def test_what_is_not_a_fault_is_refused_with_what_is_known(text: str, known: str) -> None:
    with pytest.raises(ValueError, match=known):
        parse_fault(text)


def test_a_fault_holds_from_its_start_to_its_end() -> None:
    plan = FaultPlan([parse_fault("relay:off@2s+3s")])
    verbs = [plan.verb("relay", t) for t in (1.99, 2.0, 4.99, 5.0)]
    assert verbs == [Verb.OK, Verb.OFF, Verb.OFF, Verb.OK]
    assert plan.verb("gps", 3.0) is Verb.OK


def test_the_last_declared_of_two_counts() -> None:
    plan = FaultPlan([parse_fault("relay:off"), parse_fault("relay:ok@5s")])
    assert plan.verb("relay", 1.0) is Verb.OFF
    assert plan.verb("relay", 6.0) is Verb.OK


def test_a_plan_knows_its_next_change() -> None:
    plan = FaultPlan([parse_fault("relay:off@2s+3s"), parse_fault("gps:off@4s")])
    assert [plan.next_change_s(t) for t in (0.0, 2.0, 4.0, 5.0)] == [2.0, 4.0, 5.0, math.inf]


def test_an_unknown_device_cannot_be_asked_for() -> None:
    with pytest.raises(ValueError, match="camera"):
        FaultPlan().verb("laser", 0.0)

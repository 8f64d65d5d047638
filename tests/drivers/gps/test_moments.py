"""When an epoch was, by when its sentences came."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.gps.epochs import DAY_S
from drivers.gps.moments import STEP_S, WINDOW_S, EpochMoments

DELAY_S = 0.06
BEGIN_S, DAY_BEGIN_S = 1000.0, 36_000.0


def stamps(lates: list[float], rate_hz: float = 5.0, day_begin_s: float = DAY_BEGIN_S) -> list[float]:
    """The stamps of epochs that came so late, less the true ones."""
    moments = EpochMoments(DELAY_S)
    errors = []
    for number, late_s in enumerate(lates):
        true_s = BEGIN_S + number / rate_hz
        day_s = (day_begin_s + number / rate_hz) % DAY_S
        errors.append(moments.moment_s(true_s + DELAY_S + late_s, day_s) - true_s)
    return errors


def test_a_punctual_receiver_is_stamped_with_its_epochs() -> None:
    assert stamps([0.0] * 20) == pytest.approx([0.0] * 20, abs=1e-6)


@given(st.lists(st.floats(0.0, 0.5), max_size=60))
def test_delays_on_the_way_do_not_reach_the_stamps(lates: list[float]) -> None:
    assert stamps([0.0, *lates]) == pytest.approx([0.0] * (len(lates) + 1), abs=1e-6)


@given(st.lists(st.floats(0.0, 0.5), min_size=1, max_size=60))
def test_a_stamp_is_never_before_its_epoch_nor_after_its_arrival(lates: list[float]) -> None:
    for late_s, error_s in zip(lates, stamps(lates), strict=True):
        assert -1e-6 <= error_s <= late_s + 1e-6


def test_midnight_is_no_step() -> None:
    assert stamps([0.0] + [0.1] * 30, day_begin_s=DAY_S - 2.0) == pytest.approx([0.0] * 31, abs=1e-6)


def test_a_delay_that_lasts_is_seen_as_age_at_first_and_as_the_rule_in_the_end() -> None:
    errors = stamps([0.0] * 5 + [1.0] * round(5 * (WINDOW_S + 2.0)))
    assert errors[10] == pytest.approx(0.0, abs=1e-6)
    assert errors[-1] == pytest.approx(1.0, abs=1e-6)


@pytest.mark.parametrize("step_s", [STEP_S + 1.0, 3600.0, -STEP_S - 1.0, -3600.0])
def test_a_clock_that_is_set_is_followed_at_once(step_s: float) -> None:
    moments = EpochMoments(DELAY_S)
    for number in range(10):
        moments.moment_s(BEGIN_S + 0.2 * number + DELAY_S, DAY_BEGIN_S + 0.2 * number)
    at_s = BEGIN_S + 2.0
    assert moments.moment_s(at_s + DELAY_S, DAY_BEGIN_S + 2.0 + step_s) == pytest.approx(at_s)
    assert moments.moment_s(at_s + 0.2 + DELAY_S, DAY_BEGIN_S + 2.2 + step_s) == pytest.approx(at_s + 0.2)


def test_without_a_clock_the_arrival_counts() -> None:
    assert EpochMoments(DELAY_S).moment_s(5.0, None) == pytest.approx(5.0 - DELAY_S)

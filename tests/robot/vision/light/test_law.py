"""Exposure and gain, the lamp's hysteresis, and what is trusted."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from robot.vision.light import (
    ExposureBounds,
    LampMemory,
    LampPolicy,
    LightGoals,
    LightState,
    Reading,
    Setting,
    after_switch,
    judge,
    lamp_wanted,
    next_setting,
    split,
    trusted,
)

GOALS = LightGoals()
BOUNDS = ExposureBounds(longest_s=0.04, greatest_gain=8.0, mains_hz=50)
READ = Reading(0.1, 0.1, 0.4, 0.2, 0.0, 0.0, 25.0, False, False, True)


def reads(level: float, highlight: float | None = None) -> Reading:
    return replace(READ, level=level, signal=level, highlight=2.0 * level if highlight is None else highlight)


@pytest.mark.parametrize(
    ("product_s", "mains_hz", "exposure_s", "gain"),
    [
        (0.004, 50, 0.004, 1.0),      # shorter than half a period: as it is
        (0.0101, 50, 0.010, 1.01),    # then whole half periods, and gain for the rest
        (0.0199, 50, 0.010, 1.99),
        (0.0250, 50, 0.020, 1.25),
        (0.0250, 60, 0.025, 1.0),
        (0.0240, 60, 1 / 60, 1.44),
        (0.0333, 0, 0.0333, 1.0),     # no mains, no steps
        (0.0800, 50, 0.040, 2.0),     # at the longest: gain
        (9.0, 50, 0.040, 8.0),        # no more than the bounds
        (1e-9, 50, 1e-4, 1.0),
    ],
)  # fmt: skip
def test_exposure_first_then_gain(product_s, mains_hz, exposure_s, gain):
    setting = split(product_s, replace(BOUNDS, mains_hz=mains_hz))
    assert setting.exposure_s == pytest.approx(exposure_s)
    assert setting.gain == pytest.approx(gain)


def test_a_longest_exposure_that_is_no_multiple_is_not_passed():
    assert split(math.inf, ExposureBounds(longest_s=0.035)).exposure_s == pytest.approx(0.03)
    assert split(math.inf, ExposureBounds(longest_s=0.007)).exposure_s == pytest.approx(0.007)


@pytest.mark.parametrize("level", [0.067, 0.1, 0.149])
def test_what_is_good_is_left_alone(level):
    present = Setting(0.004, 1.0)
    assert next_setting(reads(level), present, BOUNDS, GOALS) is present


def test_too_dark_gets_more_and_too_bright_less():
    present = Setting(0.004, 1.0)
    assert next_setting(reads(0.05), present, BOUNDS, GOALS).product_s == pytest.approx(0.004 * 2.0**0.9)
    assert next_setting(reads(0.2), present, BOUNDS, GOALS).product_s == pytest.approx(0.004 * 0.5**0.9)


def test_a_step_is_bounded():
    assert next_setting(reads(1e-6), Setting(0.004, 1.0), BOUNDS, GOALS).product_s == pytest.approx(0.032)
    assert next_setting(reads(0.0), Setting(0.004, 1.0), BOUNDS, GOALS).product_s == pytest.approx(0.032)


def test_highlights_hold_the_exposure_back():
    """Fruit that would burn out sets the limit, not the mean."""
    present = Setting(0.004, 1.0)
    assert next_setting(reads(0.05, 0.85), present, BOUNDS, GOALS) is present
    assert next_setting(reads(0.10, 0.99), present, BOUNDS, GOALS).product_s < present.product_s


def test_at_the_bounds_it_rests():
    longest, shortest = split(math.inf, BOUNDS), split(0.0, BOUNDS)
    assert next_setting(reads(0.001), longest, BOUNDS, GOALS) is longest
    assert next_setting(reads(1.0), shortest, BOUNDS, GOALS) is shortest


@pytest.mark.parametrize(
    ("words", "changes"),
    [
        ("shortest <= longest", {"shortest_s": 0.03, "longest_s": 0.02}),
        ("expected 1 or more, found 0.5", {"greatest_gain": 0.5}),
        ("expected 1 or more, found nan", {"greatest_gain": math.nan}),
        ("expected 0, 50 or 60, found 55", {"mains_hz": 55}),
    ],
)
def test_bounds_that_cannot_be_are_refused(words, changes):
    with pytest.raises(ValueError, match=words):
        ExposureBounds(**changes)


@pytest.mark.parametrize(
    "changes", [{"dark_signal": 0.0}, {"dark_level": 0.09}, {"dead_band": 1.0}, {"highlight": 0.05}]
)
def test_goals_that_cannot_be_are_refused(changes):
    with pytest.raises(ValueError):
        LightGoals(**changes)


@pytest.mark.parametrize(
    ("reading", "state"),
    [
        (reads(0.1), LightState.GOOD),
        (reads(0.03), LightState.DIM),
        (reads(0.004), LightState.DARK),
        (replace(reads(0.1), signal=0.001), LightState.DARK),  # bright by gain alone: all noise
        (replace(reads(0.9), burnt_share=0.6), LightState.BRIGHT),
    ],
)
def test_what_is_trusted(reading, state):
    assert judge(reading, GOALS) is state
    assert trusted(state) == (state in (LightState.GOOD, LightState.DIM))


def test_the_policies_off_and_on_do_not_look_at_the_light():
    for illumination in (0.0, 100.0):
        assert not lamp_wanted(LampPolicy.OFF, LampMemory(True, 1.0), illumination, 0.02, GOALS)
        assert lamp_wanted(LampPolicy.ON, LampMemory(), illumination, 0.02, GOALS)


def test_the_lamp_goes_on_at_dusk_and_off_by_day_and_its_own_light_changes_nothing():
    """Daylight falls and rises again past the threshold of 5 1/s; the lamp adds 6 1/s."""
    memory, lit_at, out_at = LampMemory(), [], []
    falling = [20.0 * 0.9**k for k in range(40)]
    for step, daylight in enumerate([*falling, *reversed(falling)]):
        read_1_s = daylight + (6.0 if memory.lit else 0.0)
        wanted = lamp_wanted(LampPolicy.AUTO, memory, read_1_s, 0.02, GOALS)
        if wanted != memory.lit:
            (lit_at if wanted else out_at).append((step, daylight))
            memory = after_switch(wanted, read_1_s, daylight + (6.0 if wanted else 0.0))
    assert [(step < 40, 4.4 < daylight < 5.0) for step, daylight in lit_at] == [(True, True)]
    assert [(step >= 40, 10.0 <= daylight < 11.2) for step, daylight in out_at] == [(True, True)]


@pytest.mark.parametrize("wobble", [0.7, 0.9, 1.1, 1.4])
def test_foliage_that_stands_nearer_or_farther_does_not_make_the_lamp_flicker(wobble):
    """The lamp adds more or less at the next stops than where it was lit."""
    memory = after_switch(True, 4.0, 10.0)
    assert lamp_wanted(LampPolicy.AUTO, memory, 4.0 + 6.0 * wobble, 0.02, GOALS)

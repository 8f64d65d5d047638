"""Properties of metering and exposure together, on scenes of any brightness: they come to rest, and well."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from robot.vision.light import ExposureBounds, LightGoals, Setting, meter, next_setting, split

GOALS = LightGoals()
FRAMES = 7  # from one end of the bounds to the other, and a last look
FULL_WELL_E, READ_E = 9000.0, 7.0

bounds_of = st.builds(
    ExposureBounds,
    shortest_s=st.just(1e-4),
    longest_s=st.floats(0.005, 0.06),
    greatest_gain=st.floats(1.0, 16.0),
    mains_hz=st.sampled_from([0, 50, 60]),
)
colours = {"leaf": (0.03, 0.10, 0.05), "ripe": (0.02, 0.03, 0.30), "green fruit": (0.05, 0.22, 0.14)}


def scene(plants: float, bright_fruit: float, wall: float, warmth: float) -> np.ndarray:
    """(96, 128, 3) BGR reflectances: a wall with leaves and fruit before it, in warm or cold light."""
    rng = np.random.default_rng(5)
    picture = np.full((96, 128, 3), wall)
    for _ in range(round(40 * plants)):
        x, y, leaf = rng.integers(0, 116), rng.integers(0, 86), rng.uniform(0.4, 1.6)
        picture[y : y + 10, x : x + 12] = leaf * np.array(colours["leaf"])
    picture[20:40, 20:40] = bright_fruit * np.array(colours["ripe"])
    picture[50:66, 70:86] = np.array(colours["green fruit"])
    return picture * np.array([1.0 / warmth, 1.0, warmth])


def photograph(light: np.ndarray, setting: Setting, number: int) -> np.ndarray:
    rng = np.random.default_rng(number)
    electrons = np.minimum(light * setting.exposure_s * FULL_WELL_E, FULL_WELL_E)
    noisy = electrons + rng.normal(size=light.shape) * np.sqrt(electrons + READ_E**2)
    linear = np.clip(setting.gain * noisy / FULL_WELL_E, 0.0, 1.0)
    curve = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    return np.round(255.0 * curve).astype(np.uint8)


@settings(deadline=None, max_examples=60)
@given(
    bounds=bounds_of,
    start=st.floats(0.0, 1.0),
    brightness=st.floats(-1.0, 5.0),
    plants=st.floats(0.3, 3.0),
    fruit=st.floats(0.5, 3.0),
    wall=st.floats(0.05, 0.9),
    warmth=st.floats(0.75, 1.35),
)
def test_from_any_start_in_any_light_it_comes_to_rest(bounds, start, brightness, plants, fruit, wall, warmth):
    light = 10.0**brightness * scene(plants, fruit, wall, warmth)
    shortest, longest = split(0.0, bounds), split(np.inf, bounds)
    setting = split(shortest.product_s ** (1.0 - start) * longest.product_s**start, bounds)
    for number in range(FRAMES):
        views = photograph(light, setting, 2 * number), photograph(light, setting, 2 * number + 1)
        reading = meter(*views, setting.exposure_s, setting.gain)
        following = next_setting(reading, setting, bounds, GOALS)
        assert bounds.shortest_s <= following.exposure_s <= bounds.longest_s
        assert 1.0 <= following.gain <= bounds.greatest_gain
        half_s = bounds.half_period_s
        if half_s is not None and following.exposure_s > half_s * 1.001:
            turns = following.exposure_s / half_s
            assert abs(turns - round(turns)) < 1e-9
        if following == setting:
            break
        setting = following
    else:
        raise AssertionError(f"no rest after {FRAMES} frames at {setting}: {reading}")
    well = 1.0 / GOALS.dead_band <= reading.level / GOALS.level <= GOALS.dead_band
    held_back = reading.highlight * GOALS.dead_band >= GOALS.highlight and reading.level < GOALS.level * GOALS.dead_band
    at_bounds = not 1.01 * shortest.product_s < setting.product_s < longest.product_s / 1.01
    # a gain bound below 2 leaves gaps between whole half periods, and flicker is worse than a picture that is too dark
    in_a_gap = bounds.half_period_s is not None and bounds.greatest_gain < 2.0 and reading.level < GOALS.level
    assert well or held_back or at_bounds or in_a_gap
    for number in range(100, 104):  # and it rests, whatever the noise
        views = photograph(light, setting, 2 * number), photograph(light, setting, 2 * number + 1)
        again = next_setting(meter(*views, setting.exposure_s, setting.gain), setting, bounds, GOALS)
        assert again.product_s / setting.product_s < 1.6
        assert setting.product_s / again.product_s < 2.0


@settings(deadline=None)
@given(bounds=bounds_of, product_s=st.floats(0.0, 100.0))
def test_what_is_wanted_is_set_as_far_as_the_bounds_allow(bounds, product_s):
    setting = split(product_s, bounds)
    low, high = bounds.shortest_s, split(np.inf, bounds).product_s
    clipped = min(max(product_s, low), high)
    assert setting.product_s <= clipped * (1.0 + 1e-9)
    # a gain bound below 2 leaves gaps between whole half periods
    assert setting.product_s >= clipped * min(1.0, bounds.greatest_gain / 2.0) * (1.0 - 1e-6)

"""The law of exposure: from what the meter reads to the next exposure and gain."""

from __future__ import annotations

import math
from dataclasses import dataclass

from robot.vision.light.metering import Reading
from robot.vision.light.values import LightGoals

_LONGEST_STEP = 8.0   # a picture without light tells that more is needed, not how much
_BURNT_STEP = 0.5     # nor does one that is burnt out
_BURNT = 0.95
_DAMPING = 0.9        # of the way, in stops
_SAME = 1.01


@dataclass(frozen=True, slots=True)
class Setting:
    """Exposure in seconds and linear gain; their product is what the picture's brightness goes with."""

    exposure_s: float
    gain: float

    @property
    def product_s(self) -> float:
        return self.exposure_s * self.gain


@dataclass(frozen=True, slots=True)
class ExposureBounds:
    """What may be set. ``mains_hz`` 50 or 60: exposures longer than half a period of the mains are whole multiples of
    it, so that lamps do not flicker; 0: any exposure. ``ValueError`` for bounds that leave no room."""

    shortest_s: float = 1e-4
    longest_s: float = 0.02
    greatest_gain: float = 8.0
    mains_hz: int = 50

    def __post_init__(self) -> None:
        if not 0.0 < self.shortest_s <= self.longest_s < math.inf:
            raise ValueError(
                f"exposure bounds: expected 0 < shortest <= longest, found {self.shortest_s:g} s and "
                f"{self.longest_s:g} s; correct them"
            )
        if not 1.0 <= self.greatest_gain < math.inf:
            raise ValueError(f"gain bound: expected 1 or more, found {self.greatest_gain:g}; correct it")
        if self.mains_hz not in (0, 50, 60):
            raise ValueError(f"mains_hz: expected 0, 50 or 60, found {self.mains_hz}; correct it")

    @property
    def half_period_s(self) -> float | None:
        """Of the mains; None when it does not matter."""
        return None if self.mains_hz == 0 else 0.5 / self.mains_hz


def split(product_s: float, bounds: ExposureBounds) -> Setting:
    """The setting for a product of exposure and gain, within bounds: exposure first, then gain."""
    exposure_s = min(max(product_s, bounds.shortest_s), bounds.longest_s)
    half_s = bounds.half_period_s
    if half_s is not None and exposure_s > half_s:
        exposure_s = min(math.floor(exposure_s / half_s + 1e-6) * half_s, bounds.longest_s)
    return Setting(exposure_s, min(max(product_s / exposure_s, 1.0), bounds.greatest_gain))


def next_setting(reading: Reading, present: Setting, bounds: ExposureBounds, goals: LightGoals) -> Setting:
    """What to set after a picture with ``present`` gave ``reading``; ``present`` itself when it is good, or the best.

    The step is damped, and at most a factor of eight. Iterated on one scene it comes to rest.
    """
    factor = _factor(reading, goals)
    if 1.0 / goals.dead_band <= factor <= goals.dead_band:
        return present
    step = min(max(factor**_DAMPING, 1.0 / _LONGEST_STEP), _LONGEST_STEP)
    wanted = split(present.product_s * step, bounds)
    same = 1.0 / _SAME <= wanted.product_s / present.product_s <= _SAME
    return present if same else wanted


def _factor(reading: Reading, goals: LightGoals) -> float:
    """How many times brighter the plants should be."""
    if reading.level <= 0.0:
        return math.inf
    room = _BURNT_STEP if reading.highlight >= _BURNT else goals.highlight / max(reading.highlight, 1e-6)
    return min(goals.level / reading.level, room)

"""Whether what a picture shows can be trusted, for its light."""

from __future__ import annotations

from robot.vision.light.metering import Reading
from robot.vision.light.values import LightGoals, LightState


def judge(reading: Reading, goals: LightGoals) -> LightState:
    """The state of a picture that is the best to be had."""
    if reading.burnt_share > goals.bright_share:
        return LightState.BRIGHT
    if reading.level < goals.dark_level or reading.signal < goals.dark_signal:
        return LightState.DARK
    if reading.level * goals.dead_band < goals.level:
        return LightState.DIM
    return LightState.GOOD


def trusted(state: LightState) -> bool:
    """Whether fruit found in such a picture may be sprayed."""
    return state in (LightState.GOOD, LightState.DIM)

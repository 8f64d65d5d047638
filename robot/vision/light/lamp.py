"""When the lamp is lit: at dusk, with a hysteresis that its own light does not upset."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from robot.vision.light.values import LightGoals

_OFF_MARGIN = 2.0  # daylight must be that much above the threshold before the lamp goes out


class LampPolicy(StrEnum):
    OFF = "off"
    ON = "on"
    AUTO = "auto"


@dataclass(frozen=True, slots=True)
class LampMemory:
    """Whether the lamp is lit, and what it added to the light on the plants (1/s) when it was switched on."""

    lit: bool = False
    added_1_s: float = 0.0


def lamp_wanted(
    policy: LampPolicy, memory: LampMemory, illumination_1_s: float, beyond_s: float, goals: LightGoals
) -> bool:
    """Whether the lamp should be lit, by the meter's ``illumination_1_s`` with the lamp as it is.

    With "auto" it is lit when plants at the goal's level would take more than ``beyond_s`` of exposure (times gain)
    without it, and goes out when daylight alone would do with half of that.
    """
    if policy is not LampPolicy.AUTO:
        return policy is LampPolicy.ON
    threshold_1_s = goals.level / beyond_s
    if not memory.lit:
        return illumination_1_s < threshold_1_s
    return illumination_1_s - memory.added_1_s < _OFF_MARGIN * threshold_1_s


def after_switch(lit: bool, before_1_s: float, after_1_s: float) -> LampMemory:
    """What to remember of a switch, from the illumination before and after it."""
    return LampMemory(True, max(after_1_s - before_1_s, 0.0)) if lit else LampMemory()

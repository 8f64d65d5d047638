"""How far from a fruit the nozzle stands, so that the spray cone fits the fruit."""

from __future__ import annotations

import math

from robot.aiming.parameters import AimingParameters

_SHORTER = (1.0, 0.85, 0.7)


def stand_off_m(diameter_m: float, parameters: AimingParameters) -> float:
    """Distance from nozzle tip to fruit centre: the cone's radius there is ``cone_fill`` of the fruit's radius.

    Never nearer than ``min_gap_m`` to the skin, never farther than ``max_stand_off_m`` but for that gap.
    """
    if not (math.isfinite(diameter_m) and diameter_m > 0.0):
        raise ValueError(f"diameter_m: expected a positive number, found {diameter_m}")
    radius_m = diameter_m / 2
    fitting_m = parameters.cone_fill * radius_m / math.tan(parameters.cone_half_angle_rad)
    return max(radius_m + parameters.min_gap_m, min(fitting_m, parameters.max_stand_off_m))


def stand_offs_m(diameter_m: float, parameters: AimingParameters) -> tuple[float, ...]:
    """The fitting stand-off first, then shorter ones for tight places: there the cone wets a smaller spot."""
    best_m = stand_off_m(diameter_m, parameters)
    nearest_m = diameter_m / 2 + parameters.min_gap_m
    return tuple(dict.fromkeys(max(nearest_m, factor * best_m) for factor in _SHORTER))

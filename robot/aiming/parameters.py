"""What the aiming is told by the configuration."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields


@dataclass(frozen=True, slots=True)
class AimingParameters:
    """Settings of one arm on one rig; frames and angles are the arm's own.

    ``camera_m`` (3,) is where the fruit is seen from (arm base frame): spray axes from that side are preferred.
    The spray cone of half-angle ``cone_half_angle_rad`` covers ``cone_fill`` of the fruit's radius at its centre; the
    nozzle keeps ``min_gap_m`` from the fruit's skin and at most ``max_stand_off_m`` from its centre. Axes fan out to
    ``fan_half_angle_rad`` in ``fan_directions`` directions. The arm keeps ``collision_margin_m`` from everything;
    paths are checked at least every ``path_step_rad`` a joint. ``limit_fraction`` of both motion limits is used;
    trajectories are sampled every ``sample_s``. ``goals_tried`` bounds the work for one fruit.
    """

    cone_half_angle_rad: float
    camera_m: tuple[float, float, float]
    ready_rad: tuple[float, ...]
    cone_fill: float = 0.9
    min_gap_m: float = 0.06
    max_stand_off_m: float = 0.35
    fan_half_angle_rad: float = math.radians(70.0)
    fan_directions: int = 49
    collision_margin_m: float = 0.015
    max_velocity_rad_s: float = 1.5
    max_acceleration_rad_s2: float = 4.0
    limit_fraction: float = 0.85
    path_step_rad: float = math.radians(2.0)
    sample_s: float = 0.02
    goals_tried: int = 16

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            numbers = value if isinstance(value, tuple) else (value,)
            if not all(math.isfinite(number) for number in numbers):
                raise ValueError(f"{field.name}: expected finite numbers, found {value}")
        self._within("cone_half_angle_rad", 0.01, 1.2)
        self._within("cone_fill", 0.05, 5.0)
        self._within("min_gap_m", 0.0, 1.0)
        self._within("max_stand_off_m", 0.02, 3.0)
        self._within("fan_half_angle_rad", 0.0, math.pi)
        self._within("fan_directions", 1, 1000)
        self._within("collision_margin_m", 0.0, 0.2)
        self._within("max_velocity_rad_s", 1e-3, 20.0)
        self._within("max_acceleration_rad_s2", 1e-3, 200.0)
        self._within("limit_fraction", 0.05, 1.0)
        self._within("path_step_rad", 1e-4, math.radians(2.0))
        self._within("sample_s", 1e-3, 0.02)
        self._within("goals_tried", 1, 1000)

    @property
    def path_sweep_m(self) -> float:
        """How far any point of the arm may move between two collision checks: with twice the margin, nothing is
        touched in between."""
        return max(0.002, min(0.03, 2.0 * self.collision_margin_m))

    def _within(self, name: str, low: float, high: float) -> None:
        value = getattr(self, name)
        if not low <= value <= high:
            raise ValueError(f"{name}: expected {low:g} .. {high:g}, found {value:g}; correct it")

"""What greenhouse stands round the machine, and when."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import Literal

Side = Literal["left", "right"]
Weather = Literal["clear", "overcast"]


@dataclass(frozen=True, slots=True)
class Scene:
    """One row of tomato plants beside the rover; the same scene always grows the same plants.

    ``hour`` is the clock hour, 8 to 20. ``stem_distance_m`` is how far the stems stand from the lane's centre line, on
    ``side``. Shares are fractions: ``red`` + ``turning`` + ``green`` = 1; ``cluster_share`` of the fruit hang touching
    another; ``leaf_density`` scales the number of leaves (1 is a pruned crop).
    Raises ``ValueError`` when a value is impossible.
    """

    seed: int = 1
    hour: float = 12.0
    weather: Weather = "clear"
    row_length_m: float = 4.0
    side: Side = "left"
    plant_spacing_m: float = 0.45
    stem_distance_m: float = 0.70
    wall_distance_m: float = 1.60
    fruits_per_plant: float = 5.0
    red_share: float = 0.55
    turning_share: float = 0.20
    green_share: float = 0.25
    diameter_min_m: float = 0.05
    diameter_max_m: float = 0.14
    diameter_mode_m: float = 0.075
    cluster_share: float = 0.35
    leaf_density: float = 1.0

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if isinstance(value, float) and not math.isfinite(value):
                raise ValueError(f"scene.{field.name}: expected a finite number, found {value}; give a number")
        if self.side not in ("left", "right"):
            raise ValueError(f"scene.side: expected left or right, found {self.side!r}; name the treated side")
        if self.weather not in ("clear", "overcast"):
            raise ValueError(f"scene.weather: expected clear or overcast, found {self.weather!r}; choose one")
        _within("seed", self.seed, 0, 2**63 - 1)
        _within("hour", self.hour, 8.0, 20.0)
        _within("row_length_m", self.row_length_m, 0.4, 200.0)
        _within("plant_spacing_m", self.plant_spacing_m, 0.2, 2.0)
        _within("stem_distance_m", self.stem_distance_m, 0.5, 1.2)
        _within("wall_distance_m", self.wall_distance_m, self.stem_distance_m + 0.4, 5.0)
        _within("fruits_per_plant", self.fruits_per_plant, 0.0, 12.0)
        _within("diameter_min_m", self.diameter_min_m, 0.02, 0.20)
        _within("diameter_max_m", self.diameter_max_m, self.diameter_min_m, 0.20)
        _within("diameter_mode_m", self.diameter_mode_m, self.diameter_min_m, self.diameter_max_m)
        for name in ("red_share", "turning_share", "green_share", "cluster_share"):
            _within(name, getattr(self, name), 0.0, 1.0)
        _within("leaf_density", self.leaf_density, 0.0, 3.0)
        total = self.red_share + self.turning_share + self.green_share
        if abs(total - 1.0) > 1e-6:
            raise ValueError(
                f"scene: expected red_share + turning_share + green_share = 1, found {total:.6g}; correct the shares"
            )

    @property
    def side_sign(self) -> float:
        """+1 when the row stands at the rover's left (+y), -1 at its right."""
        return 1.0 if self.side == "left" else -1.0


def _within(name: str, value: float, low: float, high: float) -> None:
    if not low <= value <= high:
        raise ValueError(f"scene.{name}: expected {low:g} to {high:g}, found {value:g}; correct the value")

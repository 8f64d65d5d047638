"""How much a fruit of a given size is due."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum


class LawKind(StrEnum):
    VOLUME = "volume"
    AREA = "area"
    FIXED = "fixed"


@dataclass(frozen=True, slots=True)
class DoseLaw:
    """Millilitres from a diameter: ``coefficient`` is ml per cm3 of fruit (volume), ml per cm2 of its surface (area)
    or ml (fixed); the dose stays in [``min_ml``, ``max_ml``].
    """

    kind: LawKind
    coefficient: float
    min_ml: float
    max_ml: float

    def __post_init__(self) -> None:
        if not (0.0 < self.coefficient < math.inf and 0.0 < self.min_ml <= self.max_ml < math.inf):
            raise ValueError(f"a dose law needs coefficient > 0 and 0 < min_ml <= max_ml, found {self}")

    def dose_ml(self, diameter_m: float) -> float:
        """What a sphere of this diameter gets: its due, inside minimum and maximum."""
        return self.within(self.due_ml(diameter_m))

    def within(self, ml: float) -> float:
        """A dose brought inside minimum and maximum."""
        return min(max(ml, self.min_ml), self.max_ml)

    def due_ml(self, diameter_m: float) -> float:
        """What the law alone asks for a sphere of this diameter: pi/6 d^3, or pi d^2 (paper, eq. 11: 4/3 pi r^3)."""
        diameter_cm = 100.0 * diameter_m
        if self.kind is LawKind.VOLUME:
            return self.coefficient * math.pi / 6.0 * diameter_cm**3
        if self.kind is LawKind.AREA:
            return self.coefficient * math.pi * diameter_cm**2
        return self.coefficient

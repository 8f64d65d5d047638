"""What may be chosen about the fruit detector."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class FruitParameters:
    """Thresholds and ranges.

    ``minimum_confidence`` 0..1 of a fruit to be reported, ``measured_chance`` of one to be called measured;
    ``least_chance`` of a proposal to be looked at, ``least_mono_chance`` of one to be reported where there is one view
    only; ``least_first_verdict`` is the logit below which the first look drops a guess. ``diameter_range_m`` and
    ``distance_range_m`` bound the search; ``proposals`` (a view) and ``candidates`` (a pair) the work.
    ``ValueError`` for an impossible value.
    """

    minimum_confidence: float = 0.5
    measured_chance: float = 0.5
    least_chance: float = 0.06
    least_mono_chance: float = 0.35
    least_first_verdict: float = -3.0
    diameter_range_m: tuple[float, float] = (0.035, 0.17)
    distance_range_m: tuple[float, float] = (0.22, 1.3)
    proposals: int = 48
    candidates: int = 32

    def __post_init__(self) -> None:
        for name in ("minimum_confidence", "measured_chance"):
            if not 0.0 <= getattr(self, name) <= 1.0:
                raise ValueError(f"{name}: expected 0 to 1, found {getattr(self, name)}")
        for name in ("least_chance", "least_mono_chance"):
            if not 0.0 < getattr(self, name) < 1.0:
                raise ValueError(f"{name}: expected between 0 and 1, found {getattr(self, name)}")
        ranges = {"diameter_range_m": self.diameter_range_m, "distance_range_m": self.distance_range_m}
        for name, (low, high) in ranges.items():
            if not 0.0 < low < high < 10.0:
                raise ValueError(f"{name}: expected 0 < low < high < 10 metres, found {low} to {high}")
        for name in ("proposals", "candidates"):
            if not 1 <= getattr(self, name) <= 400:
                raise ValueError(f"{name}: expected 1 to 400, found {getattr(self, name)}")

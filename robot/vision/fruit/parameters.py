"""What may be chosen about the fruit detector."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class FruitParameters:
    """Thresholds and ranges.

    ``minimum_confidence`` 0..1 of a fruit to be reported; ``diameter_range_m`` and ``distance_range_m`` bound the
    search; ``candidates``, ``mono_candidates`` and ``refined`` bound the work. ``ValueError`` for an impossible value.
    """

    minimum_confidence: float = 0.5
    diameter_range_m: tuple[float, float] = (0.035, 0.17)
    distance_range_m: tuple[float, float] = (0.22, 1.3)
    candidates: int = 32
    mono_candidates: int = 80
    refined: int = 20

    def __post_init__(self) -> None:
        if not 0.0 <= self.minimum_confidence <= 1.0:
            raise ValueError(f"minimum_confidence: expected 0 to 1, found {self.minimum_confidence}")
        ranges = {"diameter_range_m": self.diameter_range_m, "distance_range_m": self.distance_range_m}
        for name, (low, high) in ranges.items():
            if not 0.0 < low < high < 10.0:
                raise ValueError(f"{name}: expected 0 < low < high < 10 metres, found {low} to {high}")
        counts = {name: getattr(self, name) for name in ("candidates", "mono_candidates", "refined")}
        for name, count in counts.items():
            if not 1 <= count <= 400:
                raise ValueError(f"{name}: expected 1 to 400, found {count}")

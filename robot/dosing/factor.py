"""How ripeness changes a dose."""

from __future__ import annotations

from dataclasses import dataclass, field

from robot.targets import RipenessBorders
from robot.vision.values import Ripeness


@dataclass(frozen=True, slots=True)
class RipenessFactors:
    """What the dose law's figure is multiplied by, 0 to 2 a class.

    Inside a class its factor holds exactly. In the band around a border (``borders.band`` of score to either side) the
    factor goes over linearly to the neighbour's, so that a noisy score never makes a dose jump; unless only one of the
    two is ``treated``: then a fruit there gets the treated one's in full.
    """

    red: float = 1.0
    turning: float = 1.0
    green: float = 1.0
    treated: frozenset[Ripeness] = frozenset(Ripeness)
    borders: RipenessBorders = field(default_factory=RipenessBorders)

    def __post_init__(self) -> None:
        for kind in Ripeness:
            if not 0.0 <= self.of(kind) <= 2.0:
                raise ValueError(f"a factor must lie in 0..2, found {self.of(kind)} for {kind.value}")
            if kind in self.treated and self.of(kind) == 0.0:
                raise ValueError(f"{kind.value} fruit is treated with a factor of 0: leave it out, or give it a factor")

    def of(self, ripeness: Ripeness) -> float:
        """The factor of a fruit that is wholly of one class."""
        return {Ripeness.RED: self.red, Ripeness.TURNING: self.turning, Ripeness.GREEN: self.green}[ripeness]

    def at(self, ripeness: Ripeness, score: float) -> float:
        """The factor of a fruit by its class and score (0 green .. 1 red)."""
        borders = self.borders
        for border, less, more in (
            (borders.turning_from, Ripeness.GREEN, Ripeness.TURNING),
            (borders.red_from, Ripeness.TURNING, Ripeness.RED),
        ):
            share = (score - border + borders.band) / (2.0 * borders.band)
            if 0.0 < share < 1.0 and ripeness in (less, more) and {less, more} <= self.treated:
                return (1.0 - share) * self.of(less) + share * self.of(more)
        return self.of(ripeness)

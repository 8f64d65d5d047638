"""From the score of many looks to a class that does not flicker."""

from __future__ import annotations

from dataclasses import dataclass

from robot.vision.values import Ripeness


@dataclass(frozen=True, slots=True)
class RipenessBorders:
    """Scores (0 green .. 1 red) from which a fruit counts as turning, and as red.

    Within ``band`` on either side of a border both its classes are right: a fruit there keeps the one it has.
    """

    turning_from: float = 0.25
    red_from: float = 0.75
    band: float = 0.08

    def __post_init__(self) -> None:
        low, high = self.turning_from - self.band, self.red_from + self.band
        if not (self.band > 0.0 and low > 0.0 and self.turning_from + 2.0 * self.band < self.red_from and high < 1.0):
            raise ValueError(
                "need band > 0 and, each more than a band (or two) apart: 0, turning_from, red_from, 1; found "
                f"{self.turning_from:g}, {self.red_from:g} with a band of {self.band:g}"
            )


def classify(score: float, held: Ripeness, borders: RipenessBorders) -> Ripeness:
    """The class of a score. ``held`` is the class so far (or a first look's own): it stays within a border's band."""
    if held in (_plain(score - borders.band, borders), _plain(score + borders.band, borders)):
        return held
    return _plain(score, borders)


def _plain(score: float, borders: RipenessBorders) -> Ripeness:
    if score >= borders.red_from:
        return Ripeness.RED
    return Ripeness.TURNING if score >= borders.turning_from else Ripeness.GREEN

"""Detectors by their configured names."""

from __future__ import annotations

from typing import Literal

from robot.vision.detector import Detector

DetectorName = Literal["paper", "fruit"]


def make_detector(name: DetectorName) -> Detector:
    """The detector of that name with its default parameters; ``ValueError`` for a name that no detector has."""
    if name == "paper":
        from robot.vision.paper import PaperDetector

        return PaperDetector()
    if name == "fruit":
        from robot.vision.fruit import FruitDetector

        return FruitDetector()
    raise ValueError(f"detector must be 'paper' or 'fruit', found {name!r}")

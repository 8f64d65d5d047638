"""Who is measured."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from robot.vision.detector import Detector
from robot.vision.fruit import FruitDetector
from robot.vision.make import make_detector
from tests.bench.vision.rivals import tuned_rival

Key = Literal["paper", "fruit", "hough", "excess green"]


@dataclass(frozen=True, slots=True)
class Contestant:
    """``colour`` and ``mark`` (circle, square, diamond, triangle) are its own in every plot."""

    key: Key
    title: str
    colour: str
    mark: str


CONTESTANTS = (
    Contestant("paper", "paper (the paper’s method)", "#c05a00", "square"),
    Contestant("fruit", "fruit (this robot’s)", "#1a5fb4", "circle"),
    Contestant("hough", "OpenCV HoughCircles, tuned", "#7a4fa3", "diamond"),
    Contestant("excess green", "excess green + contours, tuned", "#3d8b40", "triangle"),
)
OWN: tuple[Key, ...] = ("paper", "fruit")


def make(key: Key) -> Detector:
    """A detector with its default parameters."""
    if key == "hough" or key == "excess green":
        return tuned_rival(key)
    return make_detector(key)


def make_staged(key: Key, on_stage: Callable[[str], None]) -> Detector:
    """A detector that tells when a stage is over, where it can."""
    if key == "fruit" and "on_stage" in inspect.signature(FruitDetector).parameters:
        construct: Callable[..., Detector] = FruitDetector
        return construct(on_stage=on_stage)
    return make(key)

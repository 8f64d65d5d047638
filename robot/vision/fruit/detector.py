"""The fruit detector: every visible fruit of a pair, ripe, turning or green, from noon to dusk.

A network proposes fruit in each view, geometry pairs the proposals, a second network traces the outlines of a pair in
both views at full resolution, a joint fit measures the fruit, and a verifier judges what came of it.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from robot.vision.fruit.checks import check_image, check_pair
from robot.vision.fruit.judge import Judge, load_judge
from robot.vision.fruit.look import Looked, look
from robot.vision.fruit.measure import Traced
from robot.vision.fruit.models import Models, load_models
from robot.vision.fruit.outlines import outline_circles
from robot.vision.fruit.parameters import FruitParameters
from robot.vision.fruit.propose import prepare, propose
from robot.vision.fruit.ripeness import kind_of
from robot.vision.fruit.suppress import keep_best
from robot.vision.fruit.uncertainty import spread_of
from robot.vision.stereo_rig import StereoRig
from robot.vision.values import Circle, Fruit, Ripeness

Array = npt.NDArray[np.float64]
Image = npt.NDArray[np.uint8]


class FruitDetector:
    """Implements ``robot.vision.detector.Detector``. One at a time: a detector serves one thread.

    ``on_stage`` is told the name of each stage when it is over. Raises ``ModelError`` when a network cannot be read.
    """

    def __init__(
        self,
        parameters: FruitParameters | None = None,
        models: Models | None = None,
        judge: Judge | None = None,
        on_stage: Callable[[str], None] | None = None,
    ) -> None:
        self._parameters = parameters or FruitParameters()
        self._models = models or load_models()
        self._judge = judge or load_judge()
        self._over = on_stage or (lambda _: None)

    def detect(self, left: Image, right: Image, rig: StereoRig) -> tuple[Fruit, ...]:
        """Fruit of one pair, most certain first.

        Raises ``ValueError`` when an image is not of the rig's size, not of three colours, or black beside the other.
        """
        check_pair(left, right, rig)
        looked = look((left, right), rig, self._models, self._parameters, self._over)
        fruits = () if looked is None else self._judged(looked, rig)
        self._over("judge")
        return fruits

    def detect_mono(self, image: Image) -> tuple[Circle, ...]:
        """Fruit of one image of any size, most certain first."""
        check_image(image)
        parameters = self._parameters
        (found,) = propose(prepare(image), self._models.proposer, parameters.least_mono_chance, parameters.proposals)
        return tuple(
            Circle(float(u), float(v), float(0.5 * np.sqrt(wide * high)), kind_of(float(ripeness)), float(chance))
            for (u, v, wide, high), chance, ripeness in zip(found.boxes, found.chance, found.ripeness, strict=True)
        )

    def _judged(self, looked: Looked, rig: StereoRig) -> tuple[Fruit, ...]:
        pair, second = looked.pair, looked.second
        confidence, well = self._judge.verdict(looked.evidence)
        fit = second.fit
        chosen = np.flatnonzero((confidence >= self._parameters.minimum_confidence) & self._plausible(second))
        rank = confidence[chosen] * (0.5 + 0.5 * well[chosen])
        kept = chosen[keep_best(fit.centre_m[chosen], fit.radius_m[chosen], rank, well[chosen])]
        kept = kept[np.argsort(-confidence[kept], kind="stable")]
        spread = spread_of(second, well, pair)
        score = 0.5 * (looked.left.ripeness + looked.right.ripeness)
        seen = looked.first.shows.mean(axis=2).min(axis=1)
        centres_m = fit.centre_m[kept] @ pair.rect_from_left
        outlines = outline_circles(centres_m, fit.radius_m[kept], rig)
        fruits = []
        for k, centre_m, (in_left, in_right) in zip(kept, centres_m, outlines, strict=True):
            kind, sure = kind_of(float(score[k])), float(confidence[k])
            fruits.append(
                Fruit(
                    centre_m=np.round(centre_m, 6),
                    covariance_m2=pair.rect_from_left.T @ spread.centre_m2[k] @ pair.rect_from_left,
                    diameter_m=float(2 * fit.volume_radius_m[k]),
                    diameter_sigma_m=float(spread.diameter_m[k]),
                    ripeness=kind,
                    ripeness_score=float(score[k]),
                    confidence=sure,
                    visible_fraction=float(seen[k]),
                    measured=bool(well[k] >= self._parameters.measured_chance),
                    left=_circle(in_left, kind, sure),
                    right=_circle(in_right, kind, sure),
                )
            )
        return tuple(fruits)

    def _plausible(self, traced: Traced) -> npt.NDArray[np.bool_]:
        fit = traced.fit
        diameter, distance = 2 * fit.volume_radius_m, fit.centre_m[:, 2]
        low, high = self._parameters.diameter_range_m
        near, far = self._parameters.distance_range_m
        finite = np.isfinite(fit.covariance).all(axis=(1, 2)) & np.isfinite(fit.centre_m).all(axis=1)
        return np.asarray(finite & (diameter > low) & (diameter < high) & (distance > near) & (distance < 1.1 * far))


def _circle(outline: Array, kind: Ripeness, sure: float) -> Circle:
    u, v, r = (float(value) for value in outline)
    return Circle(u, v, r, kind, sure)

"""The fruit detector: every visible fruit of a pair, ripe, turning or green, from noon to dusk."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from robot.vision.fruit.hypotheses import mono_hypotheses, pair_hypotheses
from robot.vision.fruit.joint_fit import Spheroids
from robot.vision.fruit.judge import judge, rank_of, ripeness_of
from robot.vision.fruit.outlines import outline_circles
from robot.vision.fruit.parameters import FruitParameters
from robot.vision.fruit.planes import Image, check_image, linear_light
from robot.vision.fruit.shortlist import shortlist
from robot.vision.fruit.suppress import keep_best, keep_best_circles
from robot.vision.fruit.uncertainty import centre_covariances, diameter_sigmas
from robot.vision.fruit.weights import Weights, load_weights
from robot.vision.stereo_rig import StereoRig
from robot.vision.values import Circle, Fruit

Array = npt.NDArray[np.float64]


class FruitDetector:
    """Finds fruit by circle evidence and judges it by a verifier trained on labelled images.

    Implements ``robot.vision.detector.Detector``.
    """

    def __init__(self, parameters: FruitParameters | None = None, weights: Weights | None = None) -> None:
        self._parameters = parameters or FruitParameters()
        self._weights = weights or load_weights()

    def detect(self, left: Image, right: Image, rig: StereoRig) -> tuple[Fruit, ...]:
        """Fruit of one pair, most certain first. Raises ``ValueError`` when an image is not of the rig's size."""
        for name, image in (("left", left), ("right", right)):
            check_image(image)
            if (image.shape[1], image.shape[0]) != tuple(rig.image_size):
                raise ValueError(
                    f"expected a {name} image of {rig.image_size[0]} x {rig.image_size[1]} pixels like the rig, "
                    f"found {image.shape[1]} x {image.shape[0]}; use the calibration made at this size"
                )
        full = linear_light(left), linear_light(right)
        found = pair_hypotheses(*full, rig, self._weights.skin, self._parameters)
        if len(found.features) == 0:
            return ()
        best = shortlist(found, full, rig, self._weights.first, self._parameters.refined)
        confidence, measured_well = judge(best.features, self._weights.final)
        chosen = np.flatnonzero((confidence >= self._parameters.minimum_confidence) & self._plausible(best.fit))
        if len(chosen) == 0:
            return ()
        rank = rank_of(confidence, measured_well)
        kept = keep_best(best.fit.centre_m[chosen], best.fit.radius_m[chosen], rank[chosen], measured_well[chosen])
        kept = chosen[kept]
        kept = kept[np.argsort(-confidence[kept], kind="stable")]
        kinds, scores = ripeness_of(best.tint[kept], self._weights.ripeness)
        fit = best.fit[kept]
        left_from_pair = found.pair.rect_from_left.T
        centres = np.round(fit.centre_m @ left_from_pair.T, 6)
        covariances = left_from_pair @ centre_covariances(fit, measured_well[kept], found.pair) @ left_from_pair.T
        diameters, sigmas = 2 * fit.volume_radius_m, diameter_sigmas(fit, measured_well[kept])
        fruits = []
        for k, row in enumerate(kept):
            sure, kind = float(confidence[row]), kinds[k]
            in_left, in_right = outline_circles(centres[k], float(fit.radius_m[k]), rig)
            fruits.append(
                Fruit(
                    centre_m=centres[k],
                    covariance_m2=covariances[k],
                    diameter_m=float(diameters[k]),
                    diameter_sigma_m=float(sigmas[k]),
                    ripeness=kind,
                    ripeness_score=float(scores[k]),
                    confidence=sure,
                    visible_fraction=float(best.seen[row]),
                    measured=bool(measured_well[row] >= 0.5),
                    left=Circle(*in_left, kind, sure),
                    right=Circle(*in_right, kind, sure),
                )
            )
        return tuple(fruits)

    def detect_mono(self, image: Image) -> tuple[Circle, ...]:
        """Fruit of one image of any size, most certain first."""
        found = mono_hypotheses(image, self._weights.skin, self._parameters)
        if len(found.circles) == 0:
            return ()
        confidence, measured_well = judge(found.view.values, self._weights.mono)
        chosen = np.flatnonzero(confidence >= self._parameters.minimum_confidence)
        if len(chosen) == 0:
            return ()
        kept = chosen[keep_best_circles(found.circles[chosen], rank_of(confidence, measured_well)[chosen])]
        kinds, _ = ripeness_of(found.view.tint[kept], self._weights.ripeness)
        return tuple(
            Circle(float(u), float(v), float(r), kind, float(c))
            for (u, v, r), kind, c in zip(found.circles[kept], kinds, confidence[kept], strict=True)
        )

    def _plausible(self, fit: Spheroids) -> npt.NDArray[np.bool_]:
        diameter = 2 * fit.volume_radius_m
        distance = fit.centre_m[:, 2]
        low, high = self._parameters.diameter_range_m
        near, far = self._parameters.distance_range_m
        finite = np.isfinite(fit.covariance).all(axis=(1, 2)) & np.isfinite(fit.centre_m).all(axis=1)
        return np.asarray(finite & (diameter > low) & (diameter < high) & (distance > near) & (distance < 1.1 * far))

"""The paper's detector: section 3.3 in each image, section 3.4 across the two."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from robot.vision.matching import match_by_row, mean_focal_px, rectified
from robot.vision.paper.outline import outlines
from robot.vision.paper.parameters import PaperParameters
from robot.vision.paper.regions import Region, round_regions
from robot.vision.paper.ripeness import ripeness_of, ripeness_score
from robot.vision.paper.three_points import circle_of
from robot.vision.stereo_rig import StereoRig
from robot.vision.triangulation import point_covariance, triangulate
from robot.vision.values import Circle, Fruit

Image = npt.NDArray[np.uint8]
Array = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class _Candidate:
    circle: tuple[float, float, float]
    circularity: float
    score: float
    outline_share: float

    def as_circle(self) -> Circle:
        return Circle(*self.circle, ripeness_of(self.score), min(1.0, self.circularity))


@dataclass(frozen=True, slots=True)
class PaperDetector:
    """Implements ``robot.vision.detector.Detector``."""

    parameters: PaperParameters = field(default_factory=PaperParameters)

    def detect(self, left: Image, right: Image, rig: StereoRig) -> tuple[Fruit, ...]:
        """Fruit of a pair of stored BGR images, from left to right; ``ValueError`` for another size than the rig's."""
        for side, image in (("left", left), ("right", right)):
            _require_bgr(image, f"the {side} image")
            if (image.shape[1], image.shape[0]) != tuple(rig.image_size):
                raise ValueError(
                    f"the {side} image is {image.shape[1]}x{image.shape[0]}, "
                    f"the rig is calibrated for {rig.image_size[0]}x{rig.image_size[1]}"
                )
        left_candidates, right_candidates = self._candidates(left), self._candidates(right)
        left_px, right_px = _centres(left_candidates), _centres(right_candidates)
        if len(left_px) == 0 or len(right_px) == 0:
            return ()
        reach_px_m = mean_focal_px(rig.K_left, rig.K_right) * rig.baseline_m
        disparity_px = (reach_px_m / self.parameters.max_distance_m, reach_px_m / self.parameters.min_distance_m)
        pairs = match_by_row(*rectified(rig, left_px, right_px), self.parameters.row_tolerance_px, disparity_px)
        if not pairs:
            return ()
        matched_left, matched_right = (list(side) for side in zip(*pairs, strict=True))
        centres_m = triangulate(
            rig.P_left,
            rig.P_right,
            rig.undistort_left(left_px[matched_left]),
            rig.undistort_right(right_px[matched_right]),
        )
        return tuple(
            self._fruit(centre_m, left_candidates[i], right_candidates[j], rig)
            for (i, j), centre_m in zip(pairs, centres_m, strict=True)
        )

    def detect_mono(self, image: Image) -> tuple[Circle, ...]:
        """Fruit of one BGR image of any size, from left to right."""
        _require_bgr(image, "the image")
        return tuple(candidate.as_circle() for candidate in self._candidates(image))

    def _candidates(self, image: Image) -> list[_Candidate]:
        found = []
        for region in round_regions(outlines(image, self.parameters), self.parameters):
            circle = circle_of(region, self.parameters)
            if circle is not None:
                score = ripeness_score(image, circle)
                found.append(_Candidate(circle, region.circularity, score, _outline_share(region, circle)))
        return sorted(found, key=lambda candidate: candidate.circle)

    def _fruit(self, centre_m: Array, left: _Candidate, right: _Candidate, rig: StereoRig) -> Fruit:
        parameters = self.parameters
        # section 3.3.4: r is the average of r1 and r2, here each in metres at the fruit's distance
        left_r_m = left.circle[2] * float(centre_m[2]) / mean_focal_px(rig.K_left)
        right_z_m = float((rig.R @ centre_m + rig.t_m)[2])
        right_r_m = right.circle[2] * right_z_m / mean_focal_px(rig.K_right)
        radius_m = (left_r_m + right_r_m) / 2.0
        covariance = point_covariance(rig.P_left, rig.P_right, centre_m, parameters.centre_sigma_px)
        distance_share = math.sqrt(covariance[2, 2]) / float(centre_m[2])
        radius_share = parameters.radius_sigma_px / (left.circle[2] + right.circle[2]) * math.sqrt(2.0)
        score = (left.score + right.score) / 2.0
        visible = min(left.outline_share, right.outline_share)
        return Fruit(
            centre_m=centre_m,
            covariance_m2=covariance,
            diameter_m=2.0 * radius_m,
            diameter_sigma_m=2.0 * radius_m * math.hypot(distance_share, radius_share),
            ripeness=ripeness_of(score),
            ripeness_score=score,
            confidence=min(1.0, (left.circularity + right.circularity) / 2.0),
            visible_fraction=visible,
            measured=visible >= parameters.measured_outline,
            left=left.as_circle(),
            right=right.as_circle(),
        )


def _require_bgr(image: Image, name: str) -> None:
    if image.ndim != 3 or image.shape[2] != 3 or image.dtype != np.uint8 or image.size == 0:
        raise ValueError(f"{name} must be (height, width, 3) of uint8 in BGR, found {image.shape} of {image.dtype}")


def _centres(candidates: list[_Candidate]) -> Array:
    return np.array([candidate.circle[:2] for candidate in candidates], dtype=np.float64).reshape(-1, 2)


def _outline_share(region: Region, circle: tuple[float, float, float]) -> float:
    """The share of 36 sectors of the circle in which the contour runs within a fifth of the radius of it."""
    u, v, r = circle
    offsets = region.contour - np.array([u, v])
    near = np.abs(np.hypot(offsets[:, 0], offsets[:, 1]) - r) <= 0.2 * r
    sectors = np.floor((np.arctan2(offsets[near, 1], offsets[near, 0]) + math.pi) / math.tau * 36.0)
    return len(np.unique(np.minimum(sectors, 35.0))) / 36.0

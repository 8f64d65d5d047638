"""What a user would pick instead: circles by the Hough transform, and contours of an excess-green threshold.

Both find circles in one image; the two images' circles are matched by the row and triangulated, as the paper does it,
but only circles of like size, and of a fruit's size where they would lie, are matched. Lengths are shares of the
image's width, so that one set of values serves every size of image.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Literal

import cv2
import numpy as np
import numpy.typing as npt

from robot.vision.matching import mean_focal_px, rectified
from robot.vision.paper.ripeness import ripeness_of, ripeness_score
from robot.vision.stereo_rig import StereoRig
from robot.vision.triangulation import point_covariance, triangulate
from robot.vision.values import Circle, Fruit

Image = npt.NDArray[np.uint8]
Array = npt.NDArray[np.float64]

RivalName = Literal["hough", "excess green"]

TUNED = Path(__file__).with_name("rival_values.json")
_DISTANCES_M, _DIAMETERS_M = (0.2, 1.5), (0.035, 0.17)
_LIKE_SIZE = 0.25  # of the logarithm of the radii's ratio
_SIGMA_PX = 2.0
MOST_CIRCLES = 100  # of one image, the best


@dataclass(frozen=True, slots=True)
class HoughValues:
    """``channel``: grey, or the red-green axis of Lab; ``edge`` and ``votes`` are OpenCV's param1 and param2."""

    channel: Literal["grey", "red"] = "grey"
    width_px: int = 640
    blur_px: int = 5
    dp: float = 1.0
    min_distance: float = 0.05
    edge: float = 100.0
    votes: float = 30.0
    min_radius: float = 0.02
    max_radius: float = 0.15
    row_tolerance: float = 0.005

    def circles(self, image: Image) -> tuple[Circle, ...]:
        """Of a BGR image, in the order of their votes."""
        width = image.shape[1]
        scale = min(1.0, self.width_px / width)
        small = image if scale == 1.0 else cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
        plane = (
            cv2.cvtColor(small, cv2.COLOR_BGR2GRAY)
            if self.channel == "grey"
            else cv2.equalizeHist(np.ascontiguousarray(cv2.cvtColor(small, cv2.COLOR_BGR2LAB)[:, :, 1]))
        )
        unit = scale * width
        found = cv2.HoughCircles(
            cv2.medianBlur(plane, self.blur_px),
            cv2.HOUGH_GRADIENT,
            self.dp,
            max(1.0, self.min_distance * unit),
            param1=self.edge,
            param2=self.votes,
            minRadius=max(2, round(self.min_radius * unit)),
            maxRadius=round(self.max_radius * unit),
        )
        if found is None:
            return ()
        rows = found.reshape(-1, 3)[:MOST_CIRCLES].astype(np.float64) / scale
        rows[:, :2] += 0.5 / scale - 0.5  # pixel centres are integers at both scales
        return tuple(_circle(image, u, v, r, 1.0 - k / len(rows)) for k, (u, v, r) in enumerate(rows))


@dataclass(frozen=True, slots=True)
class ExcessGreenValues:
    """Pixels with ``low`` <= 2g - r - b <= ``high`` (r + g + b = 1) and a mean code of ``min_code`` or more."""

    low: float = -2.0
    high: float = -0.15
    min_code: float = 10.0
    open_size: float = 0.01
    close_size: float = 0.0
    min_radius: float = 0.02
    max_radius: float = 0.2
    min_circularity: float = 0.5
    enclosing: bool = False
    row_tolerance: float = 0.005

    def circles(self, image: Image) -> tuple[Circle, ...]:
        """Of a BGR image, the roundest first."""
        width = image.shape[1]
        mask = self._mask(image)
        found = []
        for contour in cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)[0]:
            area, perimeter = cv2.contourArea(contour), cv2.arcLength(contour, True)
            if area <= 0.0 or not self.min_radius <= math.sqrt(area / math.pi) / width <= self.max_radius:
                continue
            circularity = 4.0 * math.pi * area / perimeter**2
            if circularity >= self.min_circularity:
                found.append((min(1.0, circularity), *self._circle_of(contour, area)))
        return tuple(_circle(image, u, v, r, e) for e, u, v, r in sorted(found, reverse=True)[:MOST_CIRCLES])

    def _mask(self, image: Image) -> Image:
        floats = image.astype(np.float32)
        total = floats.sum(axis=2)
        index = (3.0 * floats[:, :, 1] - total) / np.maximum(total, 1.0)
        inside = (index >= self.low) & (index <= self.high) & (total >= 3.0 * self.min_code)
        mask: Image = inside.astype(np.uint8)
        for operation, size in ((cv2.MORPH_OPEN, self.open_size), (cv2.MORPH_CLOSE, self.close_size)):
            side = round(size * image.shape[1])
            if side > 1:
                disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side))
                mask = np.asarray(cv2.morphologyEx(mask, operation, disc), dtype=np.uint8)
        return mask

    def _circle_of(self, contour: npt.NDArray[Any], area: float) -> tuple[float, float, float]:
        if self.enclosing:
            (u, v), r = cv2.minEnclosingCircle(contour)
            return float(u), float(v), float(r)
        moments = cv2.moments(contour)
        return moments["m10"] / moments["m00"], moments["m01"] / moments["m00"], math.sqrt(area / math.pi)


RivalValues = HoughValues | ExcessGreenValues


@dataclass(frozen=True, slots=True)
class Rival:
    """Implements ``robot.vision.detector.Detector``: its values are ``scenes`` for pairs, ``photos`` else."""

    scenes: RivalValues
    photos: RivalValues

    def detect(self, left: Image, right: Image, rig: StereoRig) -> tuple[Fruit, ...]:
        """Fruit of a pair, by the order of the left image's circles."""
        return located(self.scenes.circles(left), self.scenes.circles(right), rig, self.scenes.row_tolerance)

    def detect_mono(self, image: Image) -> tuple[Circle, ...]:
        return self.photos.circles(image)


def located(
    left: tuple[Circle, ...], right: tuple[Circle, ...], rig: StereoRig, row_tolerance: float
) -> tuple[Fruit, ...]:
    """Circles of both stored images matched by the row and triangulated; ``row_tolerance`` is a share of the width."""
    if not left or not right:
        return ()
    left_px, right_px = (np.array([(c.u_px, c.v_px) for c in side]) for side in (left, right))
    left_r_px, right_r_px = (np.array([c.r_px for c in side]) for side in (left, right))
    straight_left, straight_right = rectified(rig, left_px, right_px)
    row_distance = np.abs(straight_left[:, None, 1] - straight_right[None, :, 1])
    disparity = straight_left[:, None, 0] - straight_right[None, :, 0]
    focal_px = mean_focal_px(rig.K_left, rig.K_right)
    distance_m = focal_px * rig.baseline_m / np.maximum(disparity, 1e-6)
    diameter_m = (left_r_px[:, None] + right_r_px[None, :]) / focal_px * distance_m
    fits = (
        (row_distance <= row_tolerance * rig.image_size[0])
        & (np.abs(np.log(left_r_px[:, None] / right_r_px[None, :])) <= _LIKE_SIZE)
        & _within(distance_m, _DISTANCES_M)
        & _within(diameter_m, _DIAMETERS_M)
    )
    pairs = _nearest_rows_first(np.where(fits, row_distance, np.inf))
    if not pairs:
        return ()
    rows, columns = (list(side) for side in zip(*pairs, strict=True))
    centres_m = triangulate(
        rig.P_left, rig.P_right, rig.undistort_left(left_px[rows]), rig.undistort_right(right_px[columns])
    )
    return tuple(
        _fruit(centre_m, left[i], right[j], rig) for (i, j), centre_m in zip(pairs, centres_m, strict=True)
    )


def _nearest_rows_first(row_distance: Array) -> list[tuple[int, int]]:
    """Pairs of a left and a right index, each once; an infinite distance is none."""
    left = row_distance.copy()
    pairs = []
    while np.isfinite(left).any():
        i, j = np.unravel_index(int(np.argmin(left)), left.shape)
        left[i], left[:, j] = np.inf, np.inf
        pairs.append((int(i), int(j)))
    return sorted(pairs)


def _within(values: Array, bounds: tuple[float, float]) -> npt.NDArray[np.bool_]:
    return np.asarray((values >= bounds[0]) & (values <= bounds[1]))


def _fruit(centre_m: Array, left: Circle, right: Circle, rig: StereoRig) -> Fruit:
    diameter_m = (left.r_px / mean_focal_px(rig.K_left) + right.r_px / mean_focal_px(rig.K_right)) * float(centre_m[2])
    covariance = point_covariance(rig.P_left, rig.P_right, centre_m, _SIGMA_PX)
    return Fruit(
        centre_m=centre_m,
        covariance_m2=covariance,
        diameter_m=diameter_m,
        diameter_sigma_m=diameter_m * math.sqrt(covariance[2, 2]) / float(centre_m[2]),
        ripeness=left.ripeness,
        ripeness_score={"red": 1.0, "turning": 0.5, "green": 0.0}[left.ripeness.value],
        confidence=(left.confidence + right.confidence) / 2.0,
        visible_fraction=1.0,
        measured=True,
        left=left,
        right=right,
    )


def _circle(image: Image, u: float, v: float, r: float, confidence: float) -> Circle:
    ripeness = ripeness_of(ripeness_score(image, (u, v, r)))
    return Circle(float(u), float(v), float(r), ripeness, float(confidence))


@cache
def tuned() -> dict[str, Any]:
    """What ``tune_rivals`` wrote: by rival and kind of picture (scenes, photos) the values and how they were found."""
    content: dict[str, Any] = json.loads(TUNED.read_text(encoding="utf-8"))
    return content


def tuned_rival(name: RivalName) -> Rival:
    """A rival with its tuned values."""
    make: Callable[..., RivalValues] = HoughValues if name == "hough" else ExcessGreenValues
    values = tuned()[name]
    return Rival(make(**values["scenes"]["values"]), make(**values["photos"]["values"]))

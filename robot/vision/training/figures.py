"""How well trained networks do on scenes and photographs that they were not trained on."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.optimize import linear_sum_assignment

from robot.vision.fruit.detector import FruitDetector
from robot.vision.training.labelled import Photo, Scene
from robot.vision.values import Ripeness

Array = npt.NDArray[np.float64]

COUNTED_VISIBLE = 0.6
LEAST_SIDE_PX, SAME_OVERLAP = 40.0, 0.5


@dataclass(frozen=True, slots=True)
class SceneFigures:
    """``recognition`` by ripeness and of all ("all") fruit that show; ``precision``; errors of the recognised."""

    fruits: int
    recognition: dict[str, float]
    precision: float
    median_mm: float
    p95_mm: float
    depth_bias_mm: float
    diameter_percent: float


def scene_figures(detector: FruitDetector, found: Iterable[Scene]) -> SceneFigures:
    """Recognised: within half a diameter of the truth in space, one to one."""
    hits: dict[str, list[bool]] = {kind.value: [] for kind in Ripeness}
    errors: list[Array] = []
    sizes: list[float] = []
    reported = right = 0
    for scene in found:
        fruits = detector.detect(scene.left, scene.right, scene.rig)
        reported += len(fruits)
        cost = np.array(
            [
                [float(np.linalg.norm(f.centre_m - t.centre_m)) / (0.5 * t.diameter_m) for f in fruits]
                for t in scene.tomatoes
            ]
        ).reshape(len(scene.tomatoes), len(fruits))
        rows, columns = linear_sum_assignment(np.minimum(cost, 9.0))
        partner = {int(i): int(j) for i, j in zip(rows, columns, strict=True) if cost[i, j] <= 1.0}
        right += len(partner)
        for k, tomato in enumerate(scene.tomatoes):
            if tomato.visible_fraction < COUNTED_VISIBLE:
                continue
            hits[tomato.ripeness.value].append(k in partner)
            if k in partner:
                fruit = fruits[partner[k]]
                errors.append(1e3 * (fruit.centre_m - tomato.centre_m))
                sizes.append(100.0 * abs(fruit.diameter_m / tomato.diameter_m - 1.0))
    misses = np.array(errors).reshape(-1, 3) if errors else np.full((1, 3), np.nan)
    apart = np.linalg.norm(misses, axis=1)
    everything = [hit for some in hits.values() for hit in some]
    return SceneFigures(
        fruits=len(everything),
        recognition={"all": _share(everything), **{name: _share(some) for name, some in hits.items()}},
        precision=right / max(reported, 1),
        median_mm=float(np.median(apart)),
        p95_mm=float(np.percentile(apart, 95)),
        depth_bias_mm=float(np.median(misses[:, 2])),
        diameter_percent=float(np.median(sizes or [np.nan])),
    )


def _share(hits: list[bool]) -> float:
    return sum(hits) / len(hits) if hits else float("nan")


@dataclass(frozen=True, slots=True)
class PhotoFigures:
    """Of boxes with a side of at least LEAST_SIDE_PX."""

    boxes: int
    recall: float
    precision: float

    @property
    def f1(self) -> float:
        return 2 * self.recall * self.precision / max(self.recall + self.precision, 1e-9)


def photo_figures(detector: FruitDetector, found: Iterable[Photo]) -> PhotoFigures:
    """A circle is right when the square round it overlaps a box by SAME_OVERLAP, each box once. Smaller boxes, and
    circles on them, do not count."""
    boxes = reported = right = 0
    for photo in found:
        height, width = photo.image.shape[:2]
        side = np.maximum(photo.boxes[:, 2] - photo.boxes[:, 0], photo.boxes[:, 3] - photo.boxes[:, 1])
        large = side >= LEAST_SIDE_PX
        boxes += int(large.sum())
        free = np.ones(len(photo.boxes), dtype=bool)
        for circle in detector.detect_mono(photo.image):
            u, v, r = circle.u_px, circle.v_px, circle.r_px
            square = np.array([max(0.0, u - r), max(0.0, v - r), min(width, u + r), min(height, v + r)])
            overlap = np.where(free, _overlaps(square, photo.boxes), 0.0)
            best = int(overlap.argmax()) if len(overlap) else -1
            if best >= 0 and overlap[best] >= SAME_OVERLAP and large[best]:
                free[best] = False
                right += 1
            elif (best >= 0 and overlap[best] >= 0.3 and not large[best]) or 2 * r < 0.8 * LEAST_SIDE_PX:
                continue
            reported += 1
    return PhotoFigures(boxes, right / max(boxes, 1), right / max(reported, 1))


def _overlaps(box: Array, boxes: Array) -> Array:
    low, high = np.maximum(box[:2], boxes[:, :2]), np.minimum(box[2:], boxes[:, 2:])
    shared = np.clip(high - low, 0.0, None).prod(axis=1)
    area = (boxes[:, 2:] - boxes[:, :2]).prod(axis=1) + float((box[2:] - box[:2]).prod())
    return np.asarray(shared / np.maximum(area - shared, 1e-9))

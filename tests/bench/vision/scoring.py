"""Who was recognised, and what was a false alarm, in stereo scenes: one to one, nearest first, within half a diameter.

A fruit is eligible when it is visible enough in both views. Eligible fruit are matched first; what is left over may
explain the others, so that a detection of a half hidden fruit is no false alarm.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.optimize import linear_sum_assignment

from robot.vision.values import Fruit
from tests.bench.vision.labelled import SceneFacts, TrueFruit

MIN_VISIBLE = 0.6
TWO_SIGMA_CHI2 = 8.0249  # 3 degrees of freedom, share 0.9545
_NEVER = 1e3


@dataclass(frozen=True, slots=True, eq=False)
class Sighting:
    """An eligible fruit of a scene, and the detection that recognised it."""

    scene: SceneFacts
    truth: TrueFruit
    found: Fruit | None

    @property
    def error_m(self) -> npt.NDArray[np.float64] | None:
        """(3,) found less true centre, left camera frame."""
        return None if self.found is None else np.asarray(self.found.centre_m - self.truth.centre_m)

    @property
    def diameter_error(self) -> float | None:
        """Of the true diameter."""
        return None if self.found is None else self.found.diameter_m / self.truth.diameter_m - 1.0

    @property
    def in_two_sigma(self) -> bool | None:
        """Whether the error lies in the 2-sigma ellipsoid of the detection's covariance."""
        if self.found is None or self.error_m is None:
            return None
        distance2 = float(self.error_m @ np.linalg.solve(self.found.covariance_m2, self.error_m))
        return bool(0.0 <= distance2 <= TWO_SIGMA_CHI2)


@dataclass(frozen=True, slots=True, eq=False)
class Detection:
    """A detection of a scene; ``real`` when a fruit of the ground truth, eligible or not, explains it."""

    scene: SceneFacts
    fruit: Fruit
    real: bool


@dataclass(frozen=True, slots=True)
class Judged:
    """Everything there was to recognise, and everything that was reported."""

    sightings: tuple[Sighting, ...]
    detections: tuple[Detection, ...]

    @property
    def precision(self) -> float | None:
        return share(sum(d.real for d in self.detections), len(self.detections))


@dataclass(frozen=True, slots=True)
class Statistics:
    """Of eligible fruit; errors of the recognised ones. None when there is nothing to take them of."""

    eligible: int
    recognised: int
    recognition: float | None
    error_median_mm: float | None
    error_p95_mm: float | None
    depth_bias_mm: float | None
    diameter_error_median_percent: float | None
    diameter_bias_percent: float | None
    diameter_error_p95_percent: float | None
    in_two_sigma: float | None


def judge(
    scene: SceneFacts,
    truths: Sequence[TrueFruit],
    found: Sequence[Fruit],
    min_visible: float = MIN_VISIBLE,
    kinds: Collection[str] | None = None,
) -> Judged:
    """One scene; ``kinds`` restricts what is eligible to some ripeness."""
    eligible = [t.visible_fraction >= min_visible and (kinds is None or t.ripeness in kinds) for t in truths]
    first = [truth for truth, wanted in zip(truths, eligible, strict=True) if wanted]
    others = [truth for truth, wanted in zip(truths, eligible, strict=True) if not wanted]
    pairs = match(first, found)
    left_over = [k for k in range(len(found)) if k not in pairs.values()]
    explained = {left_over[k] for k in match(others, [found[k] for k in left_over]).values()}
    real = set(pairs.values()) | explained
    return Judged(
        tuple(Sighting(scene, truth, found[pairs[k]] if k in pairs else None) for k, truth in enumerate(first)),
        tuple(Detection(scene, fruit, k in real) for k, fruit in enumerate(found)),
    )


def together(parts: Iterable[Judged]) -> Judged:
    """All scenes as one."""
    every = list(parts)
    return Judged(
        tuple(sighting for part in every for sighting in part.sightings),
        tuple(detection for part in every for detection in part.detections),
    )


def match(truths: Sequence[TrueFruit], found: Sequence[Fruit]) -> dict[int, int]:
    """Index of each recognised fruit to that of its detection, by the least sum of distances in half diameters."""
    if not truths or not found:
        return {}
    places = np.array([fruit.centre_m for fruit in found])
    centres = np.array([truth.centre_m for truth in truths])
    reach = np.array([0.5 * truth.diameter_m for truth in truths])
    distance = np.linalg.norm(places[None] - centres[:, None], axis=2) / reach[:, None]
    rows, columns = linear_sum_assignment(np.where(distance <= 1.0, distance, _NEVER))
    return {int(i): int(j) for i, j in zip(rows, columns, strict=True) if distance[i, j] <= 1.0}


def statistics_of(sightings: Sequence[Sighting]) -> Statistics:
    """Recognition and errors of some eligible fruit."""
    recognised = [sighting for sighting in sightings if sighting.found is not None]
    errors_mm = 1e3 * np.array([sighting.error_m for sighting in recognised]).reshape(-1, 3)
    lengths_mm = np.linalg.norm(errors_mm, axis=1)
    diameters = 100.0 * np.array([sighting.diameter_error for sighting in recognised], dtype=np.float64)
    some = len(recognised) > 0
    return Statistics(
        eligible=len(sightings),
        recognised=len(recognised),
        recognition=share(len(recognised), len(sightings)),
        error_median_mm=float(np.median(lengths_mm)) if some else None,
        error_p95_mm=float(np.percentile(lengths_mm, 95)) if some else None,
        depth_bias_mm=float(np.median(errors_mm[:, 2])) if some else None,
        diameter_error_median_percent=float(np.median(np.abs(diameters))) if some else None,
        diameter_bias_percent=float(np.median(diameters)) if some else None,
        diameter_error_p95_percent=float(np.percentile(np.abs(diameters), 95)) if some else None,
        in_two_sigma=share(sum(bool(sighting.in_two_sigma) for sighting in recognised), len(recognised)),
    )


def share(part: int, whole: int) -> float | None:
    return part / whole if whole else None

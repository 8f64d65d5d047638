"""Which sighting of a frame is which target of the book: one to one, by position, size and their uncertainty."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt
from scipy.optimize import linear_sum_assignment

from robot.targets.ripeness import RipenessBorders
from robot.targets.sighting import Sighting
from robot.targets.values import Target


@dataclass(frozen=True, slots=True)
class BookParameters:
    """When two sightings are one fruit. Distances between centres count in units of the two radii's sum (touching = 1).

    Nearer than ``same_place`` they are one fruit whatever the covariances say: solid fruits do not overlap so far.
    Up to ``farthest_match`` they are one fruit if the Mahalanobis distance is at most ``gate_sigma``.
    Up to ``doubt`` a sighting might be a target that is not seen in its frame; a further ``doubt_margin_m`` where the
    covariances allow it. Nearer than ``overlap`` even two sightings of one frame might be one fruit.
    ``pose_sigma_m`` is what the pose adds to each axis between two frames; ``diameter_floor_m`` to a diameter.
    ``ripeness`` are the borders of the classes.
    """

    same_place: float = 0.5
    farthest_match: float = 0.8
    doubt: float = 0.9
    doubt_margin_m: float = 0.02
    overlap: float = 0.6
    gate_sigma: float = 4.0
    pose_sigma_m: float = 0.008
    diameter_floor_m: float = 0.003
    ripeness: RipenessBorders = field(default_factory=RipenessBorders)

    def __post_init__(self) -> None:
        if not 0.0 < self.same_place <= self.farthest_match <= self.doubt <= 1.0:
            raise ValueError("need 0 < same_place <= farthest_match <= doubt <= 1 (1 = the fruits touch)")
        if not 0.0 <= self.overlap <= self.doubt:
            raise ValueError("need 0 <= overlap <= doubt")
        if min(self.gate_sigma, self.pose_sigma_m, self.diameter_floor_m) <= 0.0 or self.doubt_margin_m < 0.0:
            raise ValueError(
                "gate_sigma, pose_sigma_m and diameter_floor_m must be positive, doubt_margin_m not negative"
            )


@dataclass(frozen=True, slots=True, eq=False)
class Match:
    """Sighting ``index`` (into the frame's sightings) is target ``target_id``.

    ``offset_m`` (3,) is the sighting's centre less the target's before they were merged: zeros for a ``new`` target.
    """

    index: int
    target_id: int
    new: bool
    offset_m: npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Separation:
    """Distances (m, n) of m sightings or targets from n targets."""

    metres: npt.NDArray[np.float64]
    radii: npt.NDArray[np.float64]
    sigmas: npt.NDArray[np.float64]


def separation(
    ones: Sequence[Sighting | Target], others: Sequence[Sighting | Target], parameters: BookParameters
) -> Separation:
    """Distance of every one from every other: in metres, in sums of the two radii, and Mahalanobis."""
    shape = (len(ones), len(others))
    if 0 in shape:
        return Separation(np.zeros(shape), np.zeros(shape), np.zeros(shape))
    delta = np.array([one.centre_m for one in ones])[:, None] - np.array([other.centre_m for other in others])[None]
    covariance = (
        np.array([one.covariance_m2 for one in ones])[:, None]
        + np.array([other.covariance_m2 for other in others])[None]
        + np.eye(3) * parameters.pose_sigma_m**2
    )
    touching_m = 0.5 * (
        np.array([one.diameter_m for one in ones])[:, None] + np.array([other.diameter_m for other in others])[None]
    )
    metres = np.linalg.norm(delta, axis=2)
    whitened = np.linalg.solve(covariance, delta[..., None])[..., 0]
    sigmas = np.sqrt(np.maximum(np.einsum("ijk,ijk->ij", delta, whitened), 0.0))
    return Separation(metres, metres / touching_m, sigmas)


def assign(
    sightings: Sequence[Sighting], targets: Sequence[Target], parameters: BookParameters
) -> tuple[tuple[int, int], ...]:
    """Pairs (sighting index, target index) of least total cost, each index at most once (Hungarian method).

    The cost of a pair is its squared Mahalanobis distance with the diameters' difference as a fourth, bounded
    component; leaving a sighting unmatched always costs more than an allowed match.
    """
    if not sightings or not targets:
        return ()
    apart = separation(sightings, targets, parameters)
    allowed = (apart.radii <= parameters.same_place) | (
        (apart.radii <= parameters.farthest_match) & (apart.sigmas <= parameters.gate_sigma)
    )
    ceiling = parameters.gate_sigma**2
    cost = np.minimum(apart.sigmas**2, ceiling) + np.minimum(_size_disagreement(sightings, targets, parameters), 4.0)
    forbidden = 1e3 * ceiling
    rows, columns = linear_sum_assignment(np.where(allowed, cost, forbidden))
    return tuple((int(r), int(c)) for r, c in zip(rows, columns, strict=True) if allowed[r, c])


def _size_disagreement(
    sightings: Sequence[Sighting], targets: Sequence[Target], parameters: BookParameters
) -> npt.NDArray[np.float64]:
    seen = np.array([(s.diameter_m, s.diameter_sigma_m) for s in sightings])
    known = np.array([(t.diameter_m, t.diameter_sigma_m) for t in targets])
    variance = seen[:, None, 1] ** 2 + known[None, :, 1] ** 2 + parameters.diameter_floor_m**2
    return np.asarray((seen[:, None, 0] - known[None, :, 0]) ** 2 / variance)

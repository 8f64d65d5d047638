"""The book of targets holds these."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np
import numpy.typing as npt

from robot.vision.values import Ripeness


class TargetState(StrEnum):
    """The fate of a target. OPEN may still be sprayed; every other state is final but DEFERRED."""

    OPEN = "open"
    SPRAYED = "sprayed"
    UNCERTAIN = "uncertain"      # an intent without an outcome: never sprayed again without an operator
    UNREACHABLE = "unreachable"  # not from any stop so far
    DOUBTFUL = "doubtful"        # too little evidence, or too like a target that was sprayed
    NOT_WANTED = "not_wanted"    # the policy leaves it (ripeness, size)


@dataclass(frozen=True, slots=True, eq=False)
class Target:
    """One fruit of the row, merged from all its sightings.

    ``centre_m`` (3,) and ``covariance_m2`` (3, 3) in the row frame; diameters as in ``vision.Fruit``;
    ``ripeness_score`` is the mean of all looks, each weighted by its confidence and the share that it saw;
    ``ripeness_weight`` is the sum of those weights. ``measured``: at least one look measured the size, and only such
    looks count in the diameter; else it is an estimate.
    ``reason`` says in a few words why the state is what it is; ``last_seen_s`` is the stamp of the newest frame.
    """

    id: int
    centre_m: npt.NDArray[np.float64]
    covariance_m2: npt.NDArray[np.float64]
    diameter_m: float
    diameter_sigma_m: float
    ripeness: Ripeness
    ripeness_score: float
    ripeness_weight: float
    confidence: float
    visible_fraction: float
    measured: bool
    sightings: int
    last_seen_s: float
    state: TargetState
    reason: str

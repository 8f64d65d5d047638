"""Everything up to the verdict: propose in each view, pair, trace and measure twice, gather the evidence."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from robot.vision.fruit.evidence import evidence_of
from robot.vision.fruit.measure import NARROW, WIDE, Traced, trace
from robot.vision.fruit.models import Models
from robot.vision.fruit.pairing import pairs_of
from robot.vision.fruit.parameters import FruitParameters
from robot.vision.fruit.proposals import Proposals
from robot.vision.fruit.propose import prepare, propose
from robot.vision.fruit.rectify import ParallelPair, parallel_pair
from robot.vision.stereo_rig import StereoRig

FIRST_ITERATIONS = 3
"""The first look only has to bring the second near enough."""

Array = npt.NDArray[np.float64]
Image = npt.NDArray[np.uint8]


@dataclass(frozen=True, slots=True, eq=False)
class Looked:
    """n guesses in the frame of ``pair``: their proposals in each view, two looks, ``evidence`` (n, k)."""

    pair: ParallelPair
    left: Proposals
    right: Proposals
    first: Traced
    second: Traced
    evidence: Array


def look(
    images: tuple[Image, Image], rig: StereoRig, models: Models, parameters: FruitParameters,
    over: Callable[[str], None] = lambda _: None,
) -> Looked | None:  # fmt: skip
    """None when no two proposals may be one fruit. What the first look takes for no fruit gets no second."""
    prepared = prepare(*images)
    over("prepare")
    in_left, in_right = propose(prepared, models.proposer, parameters.least_chance, parameters.proposals)
    over("propose")
    pair = parallel_pair(rig)
    guesses = pairs_of(in_left, in_right, rig, pair, parameters)
    over("pair")
    if len(guesses) == 0:
        return None
    net = models.outline
    first = trace(guesses.centre_m, guesses.radius_m, guesses.harmonic, WIDE, images, rig, pair, net, FIRST_ITERATIONS)
    rows = np.flatnonzero(first.verdict[:, 0] > parameters.least_first_verdict)
    over("first look")
    if len(rows) == 0:
        return None
    first, guesses = first[rows], guesses[rows]
    fit = first.fit
    second = trace(fit.centre_m, fit.radius_m, fit.harmonic, NARROW, images, rig, pair, net)
    over("second look")
    left, right = in_left[guesses.left], in_right[guesses.right]
    return Looked(pair, left, right, first, second, evidence_of(left, right, guesses, first, second, pair))

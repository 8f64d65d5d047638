"""Fits the verifier to the evidence of labelled scenes."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from robot.vision.fruit.look import Looked, look
from robot.vision.fruit.models import Models
from robot.vision.fruit.network import Network
from robot.vision.fruit.parameters import FruitParameters
from robot.vision.training.fitting import fit_network
from robot.vision.training.labelled import Scene

Array = npt.NDArray[np.float64]

FRUIT_WITHIN, FRUIT_SIZE = 0.5, 0.5
WELL_WITHIN, WELL_SIZE = 0.12, 0.06
"""A guess is of a fruit within this share of its diameter and of about its size; nearer, it is measured well."""
HIDDEN, COUNTED, HALF_HIDDEN_COUNTS = 0.15, 0.4, 0.4
"""Fruit that show less than the first are left out of the fit, those below the second count less."""
HIDDEN_LAYER, STEPS, DECAY = 16, 4000, 3e-3


@dataclass(frozen=True, slots=True, eq=False)
class Evidence:
    """``rows`` (n, k), ``targets`` (n, 2) and ``weights`` (n,)."""

    rows: Array
    targets: Array
    weights: Array


def gather(found: Iterable[Scene], models: Models, parameters: FruitParameters) -> Evidence:
    """The evidence of every guess in the scenes, with the truth about it."""
    rows, targets, weights = [], [], []
    for scene in found:
        looked = look((scene.left, scene.right), scene.rig, models, parameters)
        if looked is not None:
            answers, counts = truth_of(looked, scene)
            rows.append(looked.evidence)
            targets.append(answers)
            weights.append(counts)
    if not rows:
        raise ValueError("expected guesses of fruit in the scenes, found none: train the two networks longer")
    return Evidence(np.concatenate(rows), np.concatenate(targets), np.concatenate(weights))


def truth_of(looked: Looked, scene: Scene) -> tuple[Array, Array]:
    """Targets (n, 2): a fruit, a fruit measured well; and how much each counts (n,)."""
    fit = looked.second.fit
    count = len(fit.radius_m)
    if not scene.tomatoes:
        return np.zeros((count, 2)), np.ones(count)
    centre = fit.centre_m @ looked.pair.rect_from_left
    true_centre = np.array([t.centre_m for t in scene.tomatoes])
    true_diameter = np.array([t.diameter_m for t in scene.tomatoes])
    visible = np.array([t.visible_fraction for t in scene.tomatoes])
    error = np.linalg.norm(centre[:, None] - true_centre[None], axis=2) / true_diameter
    nearest = error.argmin(axis=1)
    error = error[np.arange(count), nearest]
    size = np.abs(2 * fit.volume_radius_m / true_diameter[nearest] - 1)
    fruit = (error < FRUIT_WITHIN) & (size < FRUIT_SIZE)
    well = (error < WELL_WITHIN) & (size < WELL_SIZE)
    shown = visible[nearest]
    counts = np.where(fruit & (shown < COUNTED), np.where(shown < HIDDEN, 0.0, HALF_HIDDEN_COUNTS), 1.0)
    return np.column_stack([fruit, well]).astype(np.float64), counts


def train_judge(evidence: Evidence) -> Network:
    """The same evidence gives the same verifier."""
    return fit_network(
        evidence.rows, evidence.targets, hidden=(HIDDEN_LAYER,), sample_weights=evidence.weights, steps=STEPS,
        decay=DECAY,
    )  # fmt: skip

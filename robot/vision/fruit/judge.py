"""From features to confidence and ripeness."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from robot.vision.fruit.network import Network, sigmoid
from robot.vision.values import Ripeness

Array = npt.NDArray[np.float64]
ORDER = (Ripeness.GREEN, Ripeness.TURNING, Ripeness.RED)


def judge(features: Array, network: Network) -> tuple[Array, Array]:
    """Two chances (n,) each: that a hypothesis is a fruit (its confidence), and that it is one measured well."""
    chances = np.nan_to_num(sigmoid(network.logits(features)).astype(np.float64), nan=0.0)
    return chances[:, 0], np.minimum(chances[:, 0], chances[:, 1])


def rank_of(confidence: Array, measured_well: Array) -> Array:
    """What decides between hypotheses of the same fruit (n,)."""
    return confidence * (0.2 + 0.8 * measured_well)


def ripeness_of(tint: Array, network: Network) -> tuple[tuple[Ripeness, ...], Array]:
    """The class and the score from 0 (green) to 1 (red) of (n, 4) tints."""
    chances = sigmoid(network.logits(tint)).astype(np.float64) + 1e-9
    chances /= chances.sum(axis=1, keepdims=True)
    score = chances @ np.array([0.0, 0.5, 1.0])
    return tuple(ORDER[k] for k in chances.argmax(axis=1)), score

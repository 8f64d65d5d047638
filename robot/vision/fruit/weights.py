"""The trained numbers of the fruit detector."""

from __future__ import annotations

from dataclasses import dataclass
from importlib import resources

import numpy as np

from robot.vision.fruit.network import Network, network_from

NAMES = ("skin", "first", "final", "mono", "ripeness")


@dataclass(frozen=True, slots=True, eq=False)
class Weights:
    """``skin`` judges pixels; ``first`` and ``final`` the hypotheses of a pair before and after the refinement,
    ``mono`` those of one image (logits: is it a fruit, is it measured well); ``ripeness`` tints (logits: green,
    turning, red).
    """

    skin: Network
    first: Network
    final: Network
    mono: Network
    ripeness: Network


def load_weights() -> Weights:
    """The weights that are shipped with the package (made by ``python -m robot.vision.training.verifier``)."""
    with resources.files(__package__).joinpath("weights.npz").open("rb") as file, np.load(file) as stored:
        arrays = {name: stored[name] for name in stored.files}
    return Weights(*(network_from(arrays, name) for name in NAMES))

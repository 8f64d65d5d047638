"""From evidence to confidence."""

from __future__ import annotations

from dataclasses import dataclass
from importlib import resources

import numpy as np
import numpy.typing as npt

from robot.vision.fruit.network import Network, network_from, sigmoid

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Judge:
    """``network`` gives two logits: it is a fruit; it is one whose place and size are right."""

    network: Network

    def verdict(self, evidence: Array) -> tuple[Array, Array]:
        """Two chances (n,) each: that a guess is a fruit (its confidence), and that it is one measured well."""
        chances = np.nan_to_num(sigmoid(self.network.logits(evidence)).astype(np.float64), nan=0.0)
        return chances[:, 0], np.minimum(chances[:, 0], chances[:, 1])


def load_judge() -> Judge:
    """The verifier that is shipped with the package (made by ``make train``)."""
    with resources.files(__package__).joinpath("models", "judge.npz").open("rb") as file, np.load(file) as stored:
        return Judge(network_from({name: stored[name] for name in stored.files}, "judge"))

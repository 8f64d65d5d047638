"""From evidence to confidence."""

from __future__ import annotations

import io
from dataclasses import dataclass
from importlib.resources.abc import Traversable

import numpy as np
import numpy.typing as npt

from robot.vision.fruit.models import checked, model_folder
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


def load_judge(folder: Traversable | None = None) -> Judge:
    """The verifier of a folder, by default the package's. Raises ``ModelError``."""
    place = model_folder() if folder is None else folder
    with np.load(io.BytesIO(checked(place, "judge.npz"))) as stored:
        return Judge(network_from({name: stored[name] for name in stored.files}, "judge"))

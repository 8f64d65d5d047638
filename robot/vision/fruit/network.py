"""A small fully connected network: standardise, hidden layers of rectifiers, one logit."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float32]
BLOCK = 1024
"""Rows at a time: the layers stay in the cache and their memory is reused."""


@dataclass(frozen=True, slots=True, eq=False)
class Network:
    """``mean`` and ``scale`` (n,) of the inputs; ``weights[k]`` (n_k, n_k+1) and ``biases[k]`` (n_k+1,) a layer."""

    mean: Array
    scale: Array
    weights: tuple[Array, ...]
    biases: tuple[Array, ...]

    def logits(self, features: npt.ArrayLike) -> Array:
        """(m, n) features to (m, outputs) logits. Inputs are clipped to six standard deviations."""
        rows = np.asarray(features, dtype=np.float32)
        low, high = self.mean - 6 * self.scale, self.mean + 6 * self.scale
        weights = (self.weights[0] / self.scale[:, None], *self.weights[1:])
        biases = (self.biases[0] - self.mean @ weights[0], *self.biases[1:])
        out = np.empty((len(rows), len(self.biases[-1])), dtype=np.float32)
        layers = [np.empty((BLOCK, len(self.mean)), dtype=np.float32)]
        layers += [np.empty((BLOCK, len(bias)), dtype=np.float32) for bias in biases[:-1]]
        for k in range(0, len(rows), BLOCK):
            block = rows[k : k + BLOCK]
            x = np.maximum(block, low, out=layers[0][: len(block)])
            np.minimum(x, high, out=x)
            for weight, bias, layer in zip(weights[:-1], biases[:-1], layers[1:], strict=True):
                x = np.matmul(x, weight, out=layer[: len(block)])
                x += bias
                np.maximum(x, 0.0, out=x)
            out[k : k + BLOCK] = x @ weights[-1] + biases[-1]
        return out

    def arrays(self, name: str) -> dict[str, Array]:
        """The parameters under keys that start with ``name``; the inverse of ``network_from``."""
        out = {f"{name}.mean": self.mean, f"{name}.scale": self.scale}
        for k, (weight, bias) in enumerate(zip(self.weights, self.biases, strict=True)):
            out[f"{name}.weight{k}"] = weight
            out[f"{name}.bias{k}"] = bias
        return out


def network_from(arrays: Mapping[str, npt.NDArray[np.float32]], name: str) -> Network:
    """The network stored under ``name``. Raises ``KeyError`` when there is none."""
    depth = sum(1 for key in arrays if key.startswith(f"{name}.weight"))
    return Network(
        np.asarray(arrays[f"{name}.mean"], dtype=np.float32),
        np.asarray(arrays[f"{name}.scale"], dtype=np.float32),
        tuple(np.asarray(arrays[f"{name}.weight{k}"], dtype=np.float32) for k in range(depth)),
        tuple(np.asarray(arrays[f"{name}.bias{k}"], dtype=np.float32) for k in range(depth)),
    )


def sigmoid(logits: npt.ArrayLike) -> Array:
    """1 / (1 + exp(-x)), safe at both ends."""
    return np.asarray(0.5 * (1.0 + np.tanh(0.5 * np.asarray(logits, dtype=np.float32))), dtype=np.float32)

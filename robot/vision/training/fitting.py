"""Fits the small networks: Adam on the logistic loss, in plain numpy, deterministic by seed."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import numpy.typing as npt

from robot.vision.fruit.network import Array, Network, sigmoid

NEGLIGIBLE = 1e-12
"""Smaller weights become zero: decay leaves those of dead units denormal, with which arithmetic is ten times slower."""


def fit_network(
    features: npt.ArrayLike,
    targets: npt.ArrayLike,
    *,
    hidden: tuple[int, ...] = (),
    sample_weights: npt.ArrayLike | None = None,
    steps: int = 4000,
    batch: int = 1024,
    rate: float = 3e-3,
    decay: float = 1e-4,
    seed: int = 0,
) -> Network:
    """A network of one or more logits for (m, n) ``features`` and (m,) or (m, outputs) ``targets`` in 0..1."""
    x = np.asarray(features, dtype=np.float32)
    y = np.asarray(targets, dtype=np.float32).reshape(len(x), -1)
    w = np.ones(len(x), dtype=np.float32) if sample_weights is None else np.asarray(sample_weights, dtype=np.float32)
    mean, scale = x.mean(axis=0), x.std(axis=0) + np.float32(1e-6)
    x = np.clip((x - mean) / scale, -6, 6)
    generator = np.random.default_rng(seed)
    widths = (x.shape[1], *hidden, y.shape[1])
    weights = [
        (generator.standard_normal((a, b)) * np.sqrt(2 / a) * (1.0 if b != widths[-1] else 0.3)).astype(np.float32)
        for a, b in pairwise(widths)
    ]
    biases = [np.zeros(b, dtype=np.float32) for b in widths[1:]]
    parameters = weights + biases
    first = [np.zeros_like(p) for p in parameters]
    second = [np.zeros_like(p) for p in parameters]
    for step in range(1, steps + 1):
        rows = generator.integers(0, len(x), min(batch, len(x)))
        gradients = _gradients(x[rows], y[rows], w[rows], weights, biases, decay)
        current = rate * 0.5 * (1 + np.cos(np.pi * step / steps))
        for p, g, m, v in zip(parameters, gradients, first, second, strict=True):
            m += 0.1 * (g - m)
            v += 0.001 * (g * g - v)
            p -= current * (m / (1 - 0.9**step)) / (np.sqrt(v / (1 - 0.999**step)) + 1e-8)
    for p in parameters:
        p[np.abs(p) < NEGLIGIBLE] = 0.0
    return Network(mean, scale, tuple(weights), tuple(biases))


def _gradients(x: Array, y: Array, w: Array, weights: list[Array], biases: list[Array], decay: float) -> list[Array]:
    layers = [x]
    for weight, bias in zip(weights[:-1], biases[:-1], strict=True):
        layers.append(np.maximum(layers[-1] @ weight + bias, 0))
    error = (sigmoid(layers[-1] @ weights[-1] + biases[-1]) - y) * (w / w.sum())[:, None]
    weight_gradients: list[Array] = []
    bias_gradients: list[Array] = []
    for k in reversed(range(len(weights))):
        weight_gradients.insert(0, layers[k].T @ error + decay * weights[k])
        bias_gradients.insert(0, error.sum(axis=0))
        if k:
            error = (error @ weights[k].T) * (layers[k] > 0)
    return weight_gradients + bias_gradients

"""How long to train."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Schedule:
    """``steps`` of a batch each; ``seed`` draws them, in ``workers`` processes ahead of the training."""

    steps: int
    seed: int = 0
    workers: int = 1

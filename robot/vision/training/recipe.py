"""How the shipped networks were trained."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Recipe:
    """Shares of the proposer's examples by source; the number of steps; ``twin_traced`` of the twin's scenes train the
    tracing network, the others the verifier, which so sees how the networks do on scenes that are new to them."""

    rendered_share: float = 0.45
    twin_share: float = 0.15
    photo_share: float = 0.40
    proposer_steps: int = 6500
    outline_steps: int = 5000
    twin_traced: int = 110
    seed: int = 1

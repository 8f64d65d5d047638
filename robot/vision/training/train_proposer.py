"""Trains the proposing network."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from copy import deepcopy
from multiprocessing import get_context

import cv2
import numpy as np
import torch

from robot.vision.training.augment import Example, augmented
from robot.vision.training.proposer_loss import Targets, loss_of, targets_of
from robot.vision.training.proposer_model import Proposer
from robot.vision.training.schedule import Schedule
from robot.vision.training.views import View

BATCH = 16
RATE, DECAY = 3e-3, 0.02
AVERAGE = 0.998
WARM_UP = 200


def train_proposer(sets: Sequence[tuple[float, Sequence[View]]], schedule: Schedule) -> Proposer:
    """Weights averaged over the last steps. ``sets`` are views and the share of the examples drawn from them."""
    torch.manual_seed(schedule.seed)
    torch.use_deterministic_algorithms(True)
    model = Proposer().to(memory_format=torch.channels_last)
    average = deepcopy(model)
    decayed = [p for p in model.parameters() if p.ndim > 1]
    others = [p for p in model.parameters() if p.ndim <= 1]
    optimiser = torch.optim.AdamW(
        [{"params": decayed, "weight_decay": DECAY}, {"params": others, "weight_decay": 0.0}], lr=RATE
    )
    told: dict[str, float] = {}
    for step, (planes, answers) in enumerate(_batches(sets, schedule)):
        rate = RATE * min(1.0, (step + 1) / WARM_UP) * 0.5 * (1 + math.cos(math.pi * step / schedule.steps))
        for group in optimiser.param_groups:
            group["lr"] = rate
        model.train()
        x = torch.from_numpy(planes).to(memory_format=torch.channels_last)
        with torch.autocast("cpu", torch.bfloat16):
            out, skin = model(x)
        total, parts = loss_of(out.float(), skin.float(), answers)
        optimiser.zero_grad()
        total.backward()
        torch.nn.utils.clip_grad_norm_(model.parameters(), 5.0)
        optimiser.step()
        _follow(average, model, min(AVERAGE, step / (step + 10)))
        told = {name: 0.98 * told.get(name, value) + 0.02 * value for name, value in parts.items()}
        if (step + 1) % 50 == 0:
            text = "  ".join(f"{name} {value:.3f}" for name, value in told.items())
            sys.stderr.write(f"proposer {step + 1}/{schedule.steps}  {text}\n")
    return average.eval()


def _follow(average: Proposer, model: Proposer, share: float) -> None:
    with torch.no_grad():
        for kept, now in zip(average.state_dict().values(), model.state_dict().values(), strict=True):
            if kept.dtype.is_floating_point:
                kept.lerp_(now, 1.0 - share)
            else:
                kept.copy_(now)


def _batches(
    sets: Sequence[tuple[float, Sequence[View]]], schedule: Schedule
) -> Iterator[tuple[np.ndarray, list[Targets]]]:
    """Drawn ahead in worker processes; the same for the same seed, whatever their number."""
    pool = ProcessPoolExecutor(
        schedule.workers, get_context("fork"), initializer=_prepare, initargs=(sets, schedule.seed)
    )
    try:
        ahead: list[Future[tuple[np.ndarray, list[Targets]]]] = []
        for step in range(min(schedule.steps, 2 * schedule.workers + 2)):
            ahead.append(pool.submit(_batch, step))
        for step in range(schedule.steps):
            following = step + len(ahead)
            out = ahead.pop(0).result()
            if following < schedule.steps:
                ahead.append(pool.submit(_batch, following))
            yield out
    finally:
        pool.shutdown(cancel_futures=True)


_drawn_from: tuple[Sequence[tuple[float, Sequence[View]]], int] | None = None


def _prepare(sets: Sequence[tuple[float, Sequence[View]]], seed: int) -> None:
    global _drawn_from  # noqa: PLW0603 - a worker process has nothing else to keep its views in
    cv2.setNumThreads(1)
    _drawn_from = sets, seed


def _batch(step: int) -> tuple[np.ndarray, list[Targets]]:
    assert _drawn_from is not None
    sets, seed = _drawn_from
    generator = np.random.default_rng([seed, step])
    shares = np.array([share for share, _ in sets])
    examples: list[Example] = []
    for which in generator.choice(len(sets), BATCH, p=shares / shares.sum()):
        views = sets[int(which)][1]
        examples.append(augmented(views[int(generator.integers(len(views)))], generator))
    return np.stack([e.planes for e in examples]), [targets_of(e) for e in examples]

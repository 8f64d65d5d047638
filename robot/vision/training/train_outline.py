"""Trains the tracing network."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context

import cv2
import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor
from torch.nn import functional

from robot.vision.fruit.measure import NARROW, WIDE
from robot.vision.fruit.polar import ANGLES, STEPS, sample_places, unrolled
from robot.vision.training.outline_model import Tracer
from robot.vision.training.schedule import Schedule
from robot.vision.training.traced import Known, Place, Trace, trace_answers

Array = npt.NDArray[np.float64]

SCENES_A_BATCH, GUESSES_A_SCENE = 6, 16
RATE, DECAY = 2e-3, 0.01
AVERAGE = 0.998
WARM_UP = 200
NOTHING_SHARE, ELSEWHERE_SHARE, NARROW_SHARE = 0.18, 0.22, 0.4
WIDE_ERRORS, NARROW_ERRORS = (0.20, 0.20, 0.13), (0.06, 0.06, 0.04)
"""Largest errors of the guesses: across in shares of the radius, log size, log range. Drawn evenly and beyond what the
detector meets, so that the network learns to look and not to trust the guess."""
MIRROR = (ANGLES // 2 - np.arange(ANGLES)) % ANGLES


@dataclass(frozen=True, slots=True, eq=False)
class Batch:
    """``planes`` (n, 8, ANGLES, STEPS), ``offset`` and ``shows`` (n, 2, ANGLES), ``fruit`` and ``visible`` (n,)."""

    planes: npt.NDArray[np.float32]
    offset: npt.NDArray[np.float32]
    shows: npt.NDArray[np.float32]
    fruit: npt.NDArray[np.float32]
    visible: npt.NDArray[np.float32]


def train_outline(places: Sequence[Place], schedule: Schedule) -> Tracer:
    """Weights averaged over the last steps."""
    torch.manual_seed(schedule.seed)
    torch.use_deterministic_algorithms(True)
    model, average = Tracer(), Tracer()
    optimiser = torch.optim.AdamW(model.parameters(), lr=RATE, weight_decay=DECAY)
    told: dict[str, float] = {}
    for step, batch in enumerate(_batches(places, schedule)):
        rate = RATE * min(1.0, (step + 1) / WARM_UP) * 0.5 * (1 + math.cos(math.pi * step / schedule.steps))
        for group in optimiser.param_groups:
            group["lr"] = rate
        model.train()
        rays, verdict, logits = model(torch.from_numpy(batch.planes))
        total, parts = loss_of(rays, verdict, logits, batch)
        optimiser.zero_grad()
        total.backward()
        torch.nn.utils.clip_grad_norm_(model.parameters(), 5.0)
        optimiser.step()
        share = min(AVERAGE, step / (step + 10))
        with torch.no_grad():
            for kept, now in zip(average.state_dict().values(), model.state_dict().values(), strict=True):
                kept.lerp_(now, 1.0 - share) if kept.dtype.is_floating_point else kept.copy_(now)
        told = {name: 0.98 * told.get(name, value) + 0.02 * value for name, value in parts.items()}
        if (step + 1) % 100 == 0:
            text = "  ".join(f"{name} {value:.3f}" for name, value in told.items())
            sys.stderr.write(f"outline {step + 1}/{schedule.steps}  {text}\n")
    return average.eval()


def loss_of(rays: Tensor, verdict: Tensor, logits: Tensor, batch: Batch) -> tuple[Tensor, dict[str, float]]:
    """Laplace's likelihood of the edges, cross entropy of their bins, of what shows, and of the verdict."""
    said = rays.reshape(len(rays), 3, 2, ANGLES)
    wanted = torch.from_numpy(batch.offset)
    known = torch.isfinite(wanted)
    spread = said[:, 1].clamp(-3.5, 2.5)
    miss = (said[:, 0] - torch.nan_to_num(wanted)).abs()
    edge = (miss * torch.exp(-spread) + spread)[known].mean()
    place = torch.nan_to_num(wanted) + (STEPS - 1) / 2
    low = place.floor().clamp(0, STEPS - 2).long()
    part = (place - low).clamp(0, 1)
    log_share = functional.log_softmax(logits, dim=3)
    at_low = log_share.gather(3, low[..., None])[..., 0]
    at_high = log_share.gather(3, low[..., None] + 1)[..., 0]
    bins = -((1 - part) * at_low + part * at_high)[known].mean()
    shows = torch.from_numpy(batch.shows)
    told = torch.isfinite(shows)
    seen = functional.binary_cross_entropy_with_logits(said[:, 2][told], shows[told])
    fruit = torch.from_numpy(batch.fruit)
    judged = torch.isfinite(fruit)
    right = functional.binary_cross_entropy_with_logits(verdict[judged, 0], fruit[judged])
    visible = torch.from_numpy(batch.visible)
    there = torch.isfinite(visible)
    share = functional.binary_cross_entropy_with_logits(verdict[there, 1], visible[there])
    shift = _shift(said[:, 0] - torch.nan_to_num(wanted), known)
    total = edge + 0.3 * bins + shift + 0.3 * seen + 0.6 * right + 0.2 * share
    parts = {
        "miss": miss[known].mean(), "edge": edge, "bins": bins, "shift": shift, "seen": seen, "fruit": right,
        "visible": share,
    }  # fmt: skip
    return total, {name: float(value.detach()) for name, value in parts.items()}


def _shift(miss: Tensor, known: Tensor) -> Tensor:
    """How far all edges of a view are off together: sideways between the views (that is range), and in size."""
    whole = known.all(dim=2).all(dim=1)
    if not whole.any():
        return miss.sum() * 0.0
    turn = torch.arange(ANGLES, dtype=torch.float32) * (2 * math.pi / ANGLES)
    across = 2 * (miss[whole] * torch.cos(turn)).mean(dim=2)
    between = (across[:, 0] - across[:, 1]).abs().mean()
    return between + miss[whole].mean(dim=(1, 2)).abs().mean()


def _batches(places: Sequence[Place], schedule: Schedule) -> Iterator[Batch]:
    pool = ProcessPoolExecutor(
        schedule.workers, get_context("fork"), initializer=_prepare, initargs=(places, schedule.seed)
    )
    try:
        ahead: list[Future[Batch]] = []
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


_drawn_from: tuple[Sequence[Place], int] | None = None


def _prepare(places: Sequence[Place], seed: int) -> None:
    global _drawn_from  # noqa: PLW0603 - a worker process has nothing else to keep its scenes in
    cv2.setNumThreads(1)
    _drawn_from = places, seed


def _batch(step: int) -> Batch:
    assert _drawn_from is not None
    places, seed = _drawn_from
    generator = np.random.default_rng([seed, step])
    traces: list[Trace] = []
    for which in generator.integers(len(places), size=SCENES_A_BATCH):
        traces += _traces(places[int(which)], generator)
    return Batch(
        np.stack([t.planes for t in traces]),
        np.stack([t.offset for t in traces]).astype(np.float32),
        np.stack([t.shows for t in traces]).astype(np.float32),
        np.array([t.fruit for t in traces], dtype=np.float32),
        np.array([t.visible for t in traces], dtype=np.float32),
    )


def _traces(place: Place, generator: np.random.Generator) -> list[Trace]:
    centre, radius, reach = [], [], []
    for _ in range(GUESSES_A_SCENE):
        c, r, s = _guess(place, generator)
        centre.append(c)
        radius.append(r)
        reach.append(s)
    centres, radii, reaches = np.array(centre), np.array(radius), np.array(reach)
    at, _ = sample_places(centres, radii, np.zeros((len(radii), 2)), reaches, place.rig, place.pair)
    planes = unrolled(place.images, at)
    return [
        _disturbed(trace_answers(place, planes[k], at[k], centres[k], radii[k]), generator) for k in range(len(radii))
    ]


def _guess(place: Place, generator: np.random.Generator) -> tuple[Array, float, float]:
    """A sphere that a proposal might have given: near a fruit, near one but at a wrong range, or anywhere."""
    shown = [fruit for fruit in place.fruits if fruit.visible > 0.2]
    draw = generator.random()
    if not shown or draw < NOTHING_SHARE:
        return _anywhere(place, generator), float(generator.uniform(0.022, 0.075)), WIDE
    fruit: Known = shown[int(generator.integers(len(shown)))]
    if draw < NOTHING_SHARE + ELSEWHERE_SHARE:
        stretch = np.exp(generator.choice([-1.0, 1.0]) * generator.uniform(0.06, 0.45))
        off = generator.normal(0.0, 0.25, 3) * fruit.radius_m * [1.0, 1.0, 0.0]
        radius = float(stretch * fruit.radius_m * np.exp(generator.normal(0.0, 0.15)))
        return stretch * (fruit.centre_m + off), radius, WIDE
    wide = generator.random() > NARROW_SHARE
    across, size, depth = WIDE_ERRORS if wide else NARROW_ERRORS
    centre = fruit.centre_m * np.exp(generator.uniform(-depth, depth))
    centre = centre + generator.uniform(-across, across, 3) * fruit.radius_m * [1.0, 1.0, 0.0]
    scale = np.linalg.norm(centre) / np.linalg.norm(fruit.centre_m)
    radius = float(fruit.radius_m * scale * np.exp(generator.uniform(-size, size)))
    return centre, radius, WIDE if wide else NARROW


def _anywhere(place: Place, generator: np.random.Generator) -> Array:
    width, height = place.rig.image_size
    focal = place.pair.focal_px
    range_m = float(np.exp(generator.uniform(np.log(0.3), np.log(1.2))))
    u, v = generator.uniform(0, width), generator.uniform(0, height)
    return np.array([(u - place.pair.cu) / focal * range_m, (v - place.pair.cv) / focal * range_m, range_m])


def _disturbed(trace: Trace, generator: np.random.Generator) -> Trace:
    """Mirrored, in another light and colour, with noise."""
    planes, offset, shows = trace.planes, trace.offset, trace.shows
    if generator.random() < 0.5:
        planes = planes[[3, 4, 5, 0, 1, 2, 7, 6]][:, MIRROR]
        offset, shows = offset[::-1, MIRROR], shows[::-1, MIRROR]
    codes = planes[:6] + 1.0
    tint = np.exp(generator.normal(0.0, 0.08, 3))
    between = np.exp(generator.normal(0.0, 0.02, 6))
    codes = codes * (np.tile(tint, 2) * between)[:, None, None]
    if generator.random() < 0.5:
        codes = codes ** generator.uniform(0.8, 1.2)
    if generator.random() < 0.5:
        sigma = float(np.exp(generator.uniform(np.log(0.01), np.log(0.12))))
        codes = codes + generator.normal(0.0, sigma, codes.shape)
    codes = np.clip(codes, 0.0, None)
    codes = np.minimum(codes / codes.mean(), 4.0)
    out = np.concatenate([codes - 1.0, planes[6:]]).astype(np.float32)
    return Trace(out, offset, shows, trace.fruit, trace.visible)

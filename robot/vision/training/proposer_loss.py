"""What the proposing network should say, and how wrong it is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor
from torch.nn import functional

from robot.vision.fruit.proposals import REFERENCE_PX, STRIDE
from robot.vision.training.augment import Example

Array = npt.NDArray[np.float64]

LEAST_VISIBLE = 0.25
LEAST_SIDE_PX, LEAST_LABELLED_SIDE_PX = 7.0, 13.0
"""Smaller boxes are neither asked for nor held against the network; in photographs the small are often unlabelled."""
MOST_FRUIT = 64


@dataclass(frozen=True, slots=True, eq=False)
class Targets:
    """``heat`` (h, w) 0..1 and ``care`` (h, w) of the centres; m answers at ``cells`` (m,), flat indices, that are
    ``boxes`` (m, 4) cut off at ``border`` (4,), ``visible`` and ``ripeness`` (m,), nan where unknown; ``weights`` (m,).
    ``skin`` (h, w), nan where unknown.
    """

    heat: Array
    care: Array
    cells: npt.NDArray[np.int64]
    boxes: Array
    border: Array
    visible: Array
    ripeness: Array
    weights: Array
    skin: Array


def targets_of(example: Example) -> Targets:
    """The answers to one example."""
    height, width = (side // STRIDE for side in example.planes.shape[1:])
    heat, care, owner = np.zeros((height, width)), np.ones((height, width)), np.full((height, width), -1)
    nearness = np.zeros((height, width))
    rows, columns = np.mgrid[:height, :width]
    u, v = (columns + 0.5) * STRIDE - 0.5, (rows + 0.5) * STRIDE - 0.5
    least_side = LEAST_SIDE_PX if np.isfinite(example.visible).all() else LEAST_LABELLED_SIDE_PX
    for k, (left, top, right, bottom) in enumerate(example.boxes):
        wide, high = right - left, bottom - top
        centre_u, centre_v = (left + right) / 2, (top + bottom) / 2
        shown_u = np.clip(centre_u, 0, example.planes.shape[2] - 1)
        shown_v = np.clip(centre_v, 0, example.planes.shape[1] - 1)
        out_u, out_v = abs(shown_u - centre_u) / max(wide, 1e-6), abs(shown_v - centre_v) / max(high, 1e-6)
        inside = (np.abs(u - centre_u) < wide / 2) & (np.abs(v - centre_v) < high / 2)
        hidden = example.visible[k] < LEAST_VISIBLE if np.isfinite(example.visible[k]) else False
        if hidden or min(wide, high) < least_side or max(out_u, out_v) > 0.35:
            care[inside] = 0.0
            continue
        reach = np.array([max(wide, high) * 0.11, 3.0]).max()
        near = np.exp(-0.5 * ((u - shown_u) ** 2 + (v - shown_v) ** 2) / reach**2)
        row = int(np.clip(round((shown_v + 0.5) / STRIDE - 0.5), 0, height - 1))
        column = int(np.clip(round((shown_u + 0.5) / STRIDE - 0.5), 0, width - 1))
        near[row, column] = 1.0
        heat = np.maximum(heat, near)
        ours = (near > 0.45) & (near > nearness)
        owner[ours], nearness[ours] = k, near[ours]
    care[heat > 0.3] = 1.0
    cells = np.flatnonzero(owner.ravel() >= 0)
    of = owner.ravel()[cells]
    share = 1.0 / np.bincount(of, minlength=max(1, len(example.boxes)))[of] if len(of) else np.zeros(0)
    skin = np.full((height, width), np.nan)
    if example.skin is not None:
        skin = example.skin.reshape(height, STRIDE, width, STRIDE).mean(axis=(1, 3)).astype(np.float64)
    return Targets(
        heat, care, cells, example.boxes[of], example.border, example.visible[of], example.ripeness[of], share, skin
    )


def loss_of(out: Tensor, skin: Tensor, answers: list[Targets]) -> tuple[Tensor, dict[str, float]]:
    """The sum of all losses of a batch, and its parts."""
    heat = torch.tensor(np.stack([a.heat for a in answers]), dtype=torch.float32)
    care = torch.tensor(np.stack([a.care for a in answers]), dtype=torch.float32)
    centre = _focal(out[:, 0], heat, care)
    index = np.concatenate([np.full(len(a.cells), k) for k, a in enumerate(answers)])
    zero = out.sum() * 0.0
    box = zero
    visible = zero
    ripeness = zero
    if len(index):
        cells = torch.tensor(np.concatenate([a.cells for a in answers]))
        said = out.flatten(2)[torch.tensor(index), :, cells]
        boxes = _tensor(np.concatenate([a.boxes for a in answers]))
        border = _tensor(np.concatenate([np.tile(a.border, (len(a.cells), 1)) for a in answers]))
        weights = _tensor(np.concatenate([a.weights for a in answers]))
        box = (_box_loss(said, cells, out.shape[3], boxes, border) * weights).sum() / weights.sum()
        for column, name in ((5, "visible"), (6, "ripeness")):
            wanted = _tensor(np.concatenate([getattr(a, name) for a in answers]))
            known = torch.isfinite(wanted)
            if known.any():
                part = (
                    functional.binary_cross_entropy_with_logits(
                        said[known, column], wanted[known].clamp(0, 1), weights[known], reduction="sum"
                    )
                    / weights[known].sum()
                )
                if name == "visible":
                    visible = part
                else:
                    ripeness = part
    wanted_skin = _tensor(np.stack([a.skin for a in answers]))
    known = torch.isfinite(wanted_skin)
    plain = zero
    if known.any():
        plain = functional.binary_cross_entropy_with_logits(skin[:, 0][known], wanted_skin[known])
    total = centre + 2.0 * box + 0.3 * visible + 0.3 * ripeness + 0.5 * plain
    parts = {"centre": centre, "box": box, "visible": visible, "ripeness": ripeness, "skin": plain}
    return total, {name: float(value.detach()) for name, value in parts.items()}


def _tensor(values: Array) -> Tensor:
    return torch.tensor(values, dtype=torch.float32)


def _focal(logit: Tensor, heat: Tensor, care: Tensor) -> Tensor:
    """Penalty-reduced focal loss of centre points (Zhou et al. 2019, eq. 1)."""
    chance = torch.sigmoid(logit)
    hit = functional.logsigmoid(logit)
    miss = functional.logsigmoid(-logit)
    peak = (heat >= 1.0).float()
    positive = (1 - chance) ** 2 * hit * peak
    negative = (1 - heat) ** 4 * chance**2 * miss * (1 - peak) * care
    return -(positive + negative).sum() / peak.sum().clamp(min=1.0)


def _box_loss(said: Tensor, cells: Tensor, width: int, boxes: Tensor, border: Tensor) -> Tensor:
    """1 - generalised IoU of the boxes as cut off at the border, and the misses of the whole ones' sides."""
    u = ((cells % width).float() + 0.5 + said[:, 1]) * STRIDE - 0.5
    v = (torch.div(cells, width, rounding_mode="floor").float() + 0.5 + said[:, 2]) * STRIDE - 0.5
    half = 0.5 * REFERENCE_PX * torch.exp(said[:, 3:5].clamp(-3.0, 3.0))
    drawn = torch.stack([u - half[:, 0], v - half[:, 1], u + half[:, 0], v + half[:, 1]], dim=1)
    low, high = border[:, :2].repeat(1, 2), border[:, 2:].repeat(1, 2)
    cut = torch.minimum(torch.maximum(drawn, low), high)
    wanted = torch.minimum(torch.maximum(boxes, low), high)
    shared = _area(torch.cat([torch.maximum(cut[:, :2], wanted[:, :2]), torch.minimum(cut[:, 2:], wanted[:, 2:])], 1))
    union = _area(cut) + _area(wanted) - shared
    hull = _area(torch.cat([torch.minimum(cut[:, :2], wanted[:, :2]), torch.maximum(cut[:, 2:], wanted[:, 2:])], 1))
    overlap = shared / union.clamp(min=1e-3) - (hull - union) / hull.clamp(min=1e-3)
    size = (wanted[:, 2:] - wanted[:, :2]).mean(dim=1, keepdim=True).clamp(min=4.0)
    sides = ((cut - wanted).abs() / size).clamp(max=1.0).mean(dim=1)
    return 1.0 - overlap + 2.0 * sides


def _area(boxes: Tensor) -> Tensor:
    return (boxes[:, 2] - boxes[:, 0]).clamp(min=0) * (boxes[:, 3] - boxes[:, 1]).clamp(min=0)

"""The tracing network: where on each ray of the unrolled pictures the fruit ends, how surely, and whether it is one."""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional

from robot.vision.fruit.polar import ANGLES, STEPS

CHANNELS = 8
OUTPUTS = 6 * ANGLES
"""Flat, each for the left and the right view: offset and log sigma (steps, from the middle), logit that it shows."""


class Ring(nn.Module):
    """A 3x3 convolution, closed over the angle; batch norm and a rectifier."""

    def __init__(self, inputs: int, outputs: int, stride: int = 1) -> None:
        super().__init__()
        self.conv = nn.Conv2d(inputs, outputs, 3, stride, (0, 1), bias=False)
        self.norm = nn.BatchNorm2d(outputs)

    def forward(self, x: Tensor) -> Tensor:
        closed = torch.cat([x[:, :, -1:], x, x[:, :, :1]], dim=2)
        return functional.relu(self.norm(self.conv(closed)))


class Tracer(nn.Module):
    """(n, CHANNELS, ANGLES, STEPS) to (n, OUTPUTS) of the rays and (n, 2): is it a fruit, is it measured well."""

    def __init__(self, widths: tuple[int, int, int, int] = (16, 32, 48, 64)) -> None:
        super().__init__()
        a, b, c, d = widths
        self.first = Ring(CHANNELS, a)
        self.second = nn.Sequential(Ring(a, b, 2), Ring(b, b))
        self.third = nn.Sequential(Ring(b, c, 2), Ring(c, c))
        self.fourth = nn.Sequential(Ring(c, d, 2), Ring(d, d))
        self.verdict = nn.Sequential(nn.Linear(d, 48), nn.ReLU(), nn.Linear(48, 2))
        self.up_fourth = nn.Conv2d(d, c, 1)
        self.mix_third = Ring(c, c)
        self.up_third = nn.Conv2d(c, b, 1)
        self.mix_second = Ring(b, b)
        self.up_second = nn.Conv2d(b, a, 1)
        self.mix_first = Ring(a, a)
        self.edge = nn.Conv2d(a, 2, 1)
        self.rays = nn.Conv2d(b, 4, (1, STEPS // 2))
        self.register_buffer("places", torch.arange(STEPS, dtype=torch.float32) - (STEPS - 1) / 2)

    def forward(self, x: Tensor) -> tuple[Tensor, Tensor] | tuple[Tensor, Tensor, Tensor]:
        first = self.first(x)
        second = self.second(first)
        third = self.third(second)
        fourth = self.fourth(third)
        verdict = self.verdict(fourth.mean(dim=(2, 3)))
        third = self.mix_third(_twice(self.up_fourth(fourth)) + third)
        second = self.mix_second(_twice(self.up_third(third)) + second)
        fine = self.mix_first(_twice(self.up_second(second)) + first)
        logits = self.edge(fine)
        share = torch.softmax(logits, dim=3)
        offset = (share * self.places).sum(dim=3)
        said = _twice(self.rays(second))[:, :, :, 0]
        rays = torch.cat([offset, said], dim=1).flatten(1)
        if self.training:
            return rays, verdict, logits
        return rays, verdict


def _twice(x: Tensor) -> Tensor:
    return functional.interpolate(x, scale_factor=2.0, mode="nearest")

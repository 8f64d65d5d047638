"""The proposing network: fully convolutional, plain 3x3 convolutions, one scale of output."""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional

OUTPUTS = 7
"""Centre logit, offset u and v (cells), log width and height (of REFERENCE_PX), visible and ripeness logits."""


def block(inputs: int, outputs: int, stride: int = 1, kernel: int = 3) -> nn.Sequential:
    """Convolution, batch norm, rectifier."""
    return nn.Sequential(
        nn.Conv2d(inputs, outputs, kernel, stride, kernel // 2, bias=False), nn.BatchNorm2d(outputs), nn.ReLU(True)
    )


class Residual(nn.Module):
    def __init__(self, channels: int) -> None:
        super().__init__()
        self.first = block(channels, channels)
        self.second = nn.Sequential(nn.Conv2d(channels, channels, 3, 1, 1, bias=False), nn.BatchNorm2d(channels))

    def forward(self, x: Tensor) -> Tensor:
        return functional.relu(x + self.second(self.first(x)))


def halving(inputs: int, outputs: int) -> nn.Sequential:
    """Half the resolution by a 2x2 convolution: less than half the work of a 3x3 one with stride."""
    return nn.Sequential(nn.Conv2d(inputs, outputs, 2, 2, bias=False), nn.BatchNorm2d(outputs), nn.ReLU(True))


class Proposer(nn.Module):
    """(n, 3, h, w) to (n, OUTPUTS, h/4, w/4), and while training a logit of skin (n, 1, h/4, w/4) beside it.

    h and w are multiples of 16.
    """

    def __init__(self, widths: tuple[int, int, int, int] = (16, 24, 64, 112), neck: tuple[int, int] = (24, 64)):
        super().__init__()
        stem, quarter, eighth, sixteenth = widths
        fine, coarse = neck
        self.stem = block(3, stem, 2)
        self.quarter = nn.Sequential(halving(stem, quarter), Residual(quarter))
        self.eighth = nn.Sequential(halving(quarter, eighth), Residual(eighth))
        self.sixteenth = nn.Sequential(halving(eighth, sixteenth), Residual(sixteenth), Residual(sixteenth))
        self.up_sixteenth = block(sixteenth, coarse, kernel=1)
        self.from_eighth = block(eighth, coarse, kernel=1)
        self.mix_eighth = block(coarse, coarse)
        self.up_eighth = block(coarse, fine, kernel=1)
        self.from_quarter = block(quarter, fine, kernel=1)
        self.mix_quarter = block(fine, fine)
        self.head = block(fine, fine)
        self.out = nn.Conv2d(fine, OUTPUTS, 1)
        self.skin = nn.Conv2d(fine, 1, 1)
        nn.init.normal_(self.out.weight, std=0.01)
        with torch.no_grad():
            self.out.bias.zero_()
            self.out.bias[0] = -4.0

    def forward(self, x: Tensor) -> Tensor | tuple[Tensor, Tensor]:
        quarter = self.quarter(self.stem(x))
        eighth = self.eighth(quarter)
        coarse = _twice(self.up_sixteenth(self.sixteenth(eighth))) + self.from_eighth(eighth)
        fine = _twice(self.up_eighth(self.mix_eighth(coarse))) + self.from_quarter(quarter)
        fine = self.mix_quarter(fine)
        out: Tensor = self.out(self.head(fine))
        if self.training:
            return out, self.skin(fine)
        return out


def _twice(x: Tensor) -> Tensor:
    return functional.interpolate(x, scale_factor=2.0, mode="nearest")

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


class Proposer(nn.Module):
    """(n, 3, h, w) to (n, OUTPUTS, h/4, w/4), and while training a logit of skin (n, 1, h/4, w/4) beside it."""

    def __init__(self, widths: tuple[int, ...] = (16, 24, 64, 128, 160), neck: tuple[int, int, int] = (32, 64, 64)):
        super().__init__()
        stem, quarter, eighth, sixteenth, last = widths
        self.stem = block(3, stem, 2)
        self.quarter = nn.Sequential(block(stem, quarter, 2), Residual(quarter))
        self.eighth = nn.Sequential(block(quarter, eighth, 2), Residual(eighth))
        self.sixteenth = nn.Sequential(block(eighth, sixteenth, 2), Residual(sixteenth))
        self.last = nn.Sequential(block(sixteenth, last, 2), Residual(last))
        self.from_last = block(last, neck[2], kernel=1)
        self.from_sixteenth = block(sixteenth, neck[2], kernel=1)
        self.mix_sixteenth = block(neck[2], neck[2])
        self.up_sixteenth = block(neck[2], neck[1], kernel=1)
        self.from_eighth = block(eighth, neck[1], kernel=1)
        self.mix_eighth = block(neck[1], neck[1])
        self.up_eighth = block(neck[1], neck[0], kernel=1)
        self.from_quarter = block(quarter, neck[0], kernel=1)
        self.mix_quarter = block(neck[0], neck[0])
        self.head = block(neck[0], neck[0])
        self.out = nn.Conv2d(neck[0], OUTPUTS, 1)
        self.skin = nn.Conv2d(neck[0], 1, 1)
        nn.init.normal_(self.out.weight, std=0.01)
        with torch.no_grad():
            self.out.bias.zero_()
            self.out.bias[0] = -4.0

    def forward(self, x: Tensor) -> Tensor | tuple[Tensor, Tensor]:
        quarter = self.quarter(self.stem(x))
        eighth = self.eighth(quarter)
        sixteenth = self.sixteenth(eighth)
        top = _twice(self.from_last(self.last(sixteenth)))
        middle = self.mix_sixteenth(top + self.from_sixteenth(sixteenth))
        middle = self.mix_eighth(_twice(self.up_sixteenth(middle)) + self.from_eighth(eighth))
        fine = self.mix_quarter(_twice(self.up_eighth(middle)) + self.from_quarter(quarter))
        out: Tensor = self.out(self.head(fine))
        if self.training:
            return out, self.skin(fine)
        return out


def _twice(x: Tensor) -> Tensor:
    return functional.interpolate(x, scale_factor=2.0, mode="nearest")

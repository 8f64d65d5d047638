"""Trained networks as the ONNX files that OpenCV runs, with their digests."""

from __future__ import annotations

import hashlib
import io
import json
import warnings
from collections.abc import Mapping
from pathlib import Path

import torch
from torch import nn

from robot.vision.fruit.models import DIGESTS
from robot.vision.fruit.polar import ANGLES, STEPS
from robot.vision.training.outline_model import CHANNELS, Tracer
from robot.vision.training.proposer_model import Proposer

OPSET = 13


def export_proposer(model: Proposer) -> bytes:
    """Takes (n, 3, h, w) with h and w multiples of 16, "planes"; gives "answer"."""
    return _export(model, torch.zeros(2, 3, 240, 320), ["planes"], ["answer"], {"planes": {0: "n", 2: "h", 3: "w"}})


def export_outline(model: Tracer) -> bytes:
    """Takes (1, CHANNELS, ANGLES, STEPS), "planes"; gives "rays" and "verdict"."""
    return _export(model, torch.zeros(1, CHANNELS, ANGLES, STEPS), ["planes"], ["rays", "verdict"], {})


def write_models(folder: Path, files: Mapping[str, bytes]) -> None:
    """Each file, and the digests of all that stand there."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, data in files.items():
        (folder / name).write_bytes(data)
    kept = sorted(path for path in folder.iterdir() if path.suffix in (".onnx", ".npz"))
    digests = {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in kept}
    (folder / DIGESTS).write_text(json.dumps(digests, indent=1) + "\n", encoding="utf-8")


def _export(
    model: nn.Module, example: torch.Tensor, inputs: list[str], outputs: list[str], axes: dict[str, dict[int, str]]
) -> bytes:
    buffer = io.BytesIO()
    model.eval()
    with warnings.catch_warnings():
        # the older of the two exporters writes the plain operators that OpenCV reads, and says that it is the older
        warnings.simplefilter("ignore", DeprecationWarning)
        torch.onnx.export(
            model, (example,), buffer, opset_version=OPSET, input_names=inputs, output_names=outputs,
            dynamic_axes=axes or None, dynamo=False,
        )  # fmt: skip
    return buffer.getvalue()

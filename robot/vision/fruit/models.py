"""The trained networks that are shipped with the package."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from importlib import resources
from importlib.resources.abc import Traversable

import cv2
import numpy as np
import numpy.typing as npt

Plane = npt.NDArray[np.float32]

NAMES = ("proposer", "outline")
REMEDY = "install the package again, or make the weights anew with 'make train'"


class ModelError(ValueError):
    """A network's file is missing, or is not what was shipped."""


@dataclass(frozen=True, slots=True)
class Models:
    """``proposer``: (n, 3, h, w) to (n, 7, h/4, w/4); ``outline``: (n, 8, 48, 24) to (n, 288) and (n, 2)."""

    proposer: cv2.dnn.Net
    outline: cv2.dnn.Net


def load_models(folder: Traversable | None = None) -> Models:
    """The networks of a folder, by default the package's. Raises ``ModelError``."""
    place = resources.files(__package__).joinpath("models") if folder is None else folder
    digests = _digests(place)
    nets = [_net(place.joinpath(f"{name}.onnx"), digests.get(name, "")) for name in NAMES]
    return Models(*nets)


def _digests(place: Traversable) -> dict[str, str]:
    path = place.joinpath("digests.json")
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise ModelError(f"expected the digests of the networks at {path}, found none ({error}); {REMEDY}") from error
    if not isinstance(content, dict):
        raise ModelError(f"expected digests by name in {path}, found {type(content).__name__}; {REMEDY}")
    return {str(name): str(value) for name, value in content.items()}


def _net(path: Traversable, digest: str) -> cv2.dnn.Net:
    try:
        data = path.read_bytes()
    except OSError as error:
        raise ModelError(f"expected a network at {path}, found none ({error.strerror}); {REMEDY}") from error
    found = hashlib.sha256(data).hexdigest()
    if found != digest:
        raise ModelError(f"{path}: expected the digest {digest[:12] or 'none'}, found {found[:12]}; {REMEDY}")
    buffer = np.frombuffer(data, dtype=np.uint8)
    try:
        # OpenCV 5 has a second engine, which is slower on plain convolutions; OpenCV 4 knows this one only
        classic = getattr(cv2.dnn, "ENGINE_CLASSIC", None)
        return cv2.dnn.readNetFromONNX(buffer) if classic is None else cv2.dnn.readNetFromONNX(buffer, classic)
    except cv2.error as error:
        raise ModelError(f"{path}: not a network that this OpenCV reads ({error.err}); {REMEDY}") from error

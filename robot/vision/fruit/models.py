"""The trained networks that are shipped with the package."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from importlib import resources
from importlib.resources.abc import Traversable

import cv2

from robot.errors import FileError

DIGESTS = "digests.json"
REMEDY = "install the package again, or make the weights anew with 'make train'"


class ModelError(FileError):
    """A network's file is missing, or is not what was shipped."""


@dataclass(frozen=True, slots=True)
class Models:
    """``proposer``: (n, 3, h, w) to (n, 7, h/4, w/4); ``outline``: (n, 8, 48, 24) to (n, 288) and (n, 2)."""

    proposer: cv2.dnn.Net
    outline: cv2.dnn.Net


def model_folder() -> Traversable:
    """Where the package keeps its networks."""
    return resources.files(__package__).joinpath("models")


def load_models(folder: Traversable | None = None) -> Models:
    """The networks of a folder, by default the package's. Raises ``ModelError``."""
    place = model_folder() if folder is None else folder
    return Models(_net(place, "proposer.onnx"), _net(place, "outline.onnx"))


def checked(folder: Traversable, name: str) -> bytes:
    """The content of a file whose digest is right. Raises ``ModelError``."""
    path = folder.joinpath(name)
    try:
        digest = json.loads(folder.joinpath(DIGESTS).read_text(encoding="utf-8"))[name]
    except (OSError, ValueError, TypeError, KeyError) as error:
        place = folder.joinpath(DIGESTS)
        raise ModelError(f"expected the digest of {name} in {place}, found none ({error!r}); {REMEDY}") from error
    try:
        data = path.read_bytes()
    except OSError as error:
        raise ModelError(f"expected a network at {path}, found none ({error.strerror}); {REMEDY}") from error
    found = hashlib.sha256(data).hexdigest()
    if found != digest:
        raise ModelError(f"{path}: expected the digest {str(digest)[:12]}, found {found[:12]}; {REMEDY}")
    return data


def _net(folder: Traversable, name: str) -> cv2.dnn.Net:
    checked(folder, name)
    path = folder.joinpath(name)
    # OpenCV 5 has a second engine, slower on plain convolutions; OpenCV 4 has this one only
    classic = getattr(cv2.dnn, "ENGINE_CLASSIC", None)
    try:
        with resources.as_file(path) as file:
            return cv2.dnn.readNetFromONNX(str(file), *(() if classic is None else (classic,)))
    except cv2.error as error:
        raise ModelError(f"{path}: not a network that this OpenCV reads ({error.err}); {REMEDY}") from error

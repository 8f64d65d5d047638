"""Labelled images from disk: rendered stereo scenes with ground truth, and photographs with boxes."""

from __future__ import annotations

import json
import xml.etree.ElementTree as ET
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from robot.vision.fruit.planes import Image
from robot.vision.stereo_rig import StereoRig
from robot.vision.values import Ripeness

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Tomato:
    """``number`` is its value in the masks; ``centre_m`` (3,) in the left camera frame."""

    number: int
    centre_m: Array
    diameter_m: float
    ripeness: Ripeness
    visible_fraction: float


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """A stereo pair; masks (height, width) hold a fruit's number on its skin, 0 elsewhere, 100 and up on calyx."""

    name: str
    left: Image
    right: Image
    mask_left: npt.NDArray[np.uint8]
    mask_right: npt.NDArray[np.uint8]
    rig: StereoRig
    tomatoes: tuple[Tomato, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Photo:
    """A photograph and its boxes (n, 4) of xmin, ymin, xmax, ymax in pixels."""

    name: str
    image: Image
    boxes: Array


def scenes(folder: Path, only: Collection[str] | None = None) -> Iterator[Scene]:
    """Every ``<id>.json`` of a folder (or ``only`` some ids) with its images and masks.

    ``calib_<rig>.json`` stands there or one above. Raises ``FileNotFoundError`` for what is missing.
    """
    for path in sorted(folder.glob("*.json")):
        if only is not None and path.stem not in only:
            continue
        truth = json.loads(path.read_text())
        if "tomatoes" not in truth:
            continue
        stem = path.with_suffix("")
        yield Scene(
            name=path.stem,
            left=_read(Path(f"{stem}_left.jpg"), cv2.IMREAD_COLOR),
            right=_read(Path(f"{stem}_right.jpg"), cv2.IMREAD_COLOR),
            mask_left=_read(Path(f"{stem}_mask_left.png"), cv2.IMREAD_GRAYSCALE),
            mask_right=_read(Path(f"{stem}_mask_right.png"), cv2.IMREAD_GRAYSCALE),
            rig=_rig(folder, truth["rig"]),
            tomatoes=tuple(
                Tomato(
                    int(t["id"]),
                    np.array(t["centre_m"], dtype=np.float64),
                    float(t["diameter_m"]),
                    Ripeness(t["ripeness"]),
                    float(t["visible_fraction_min"]),
                )
                for t in truth["tomatoes"]
            ),
        )


def photos(folder: Path, split: str) -> Iterator[Photo]:
    """The photographs named in ``<split>.txt`` with their PASCAL VOC boxes."""
    for name in (folder / f"{split}.txt").read_text().split():
        root = ET.parse(folder / "annotations" / f"{name}.xml").getroot()
        boxes = [
            [float(box.findtext(key, "nan")) for key in ("xmin", "ymin", "xmax", "ymax")] for box in root.iter("bndbox")
        ]
        yield Photo(name, _read(folder / "images" / f"{name}.jpg", cv2.IMREAD_COLOR), np.array(boxes).reshape(-1, 4))


def _read(path: Path, mode: int) -> npt.NDArray[np.uint8]:
    image = cv2.imread(str(path), mode)
    if image is None:
        raise FileNotFoundError(f"expected an image at {path}, found none that can be read; check the data folder")
    return np.asarray(image, dtype=np.uint8)


def _rig(folder: Path, name: str) -> StereoRig:
    for place in (folder, folder.parent):
        path = place / f"calib_{name}.json"
        if path.exists():
            data = json.loads(path.read_text())
            names = ("K_left", "K_right", "dist_left", "dist_right", "R", "t_m")
            arrays = {name: np.array(data[name], dtype=np.float64) for name in names}
            width, height = data["image_size"]
            return StereoRig((int(width), int(height)), **arrays)
    raise FileNotFoundError(f"expected calib_{name}.json in {folder} or {folder.parent}, found none")

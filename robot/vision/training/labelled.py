"""Labelled images from disk: rendered stereo scenes with ground truth, and photographs with boxes."""

from __future__ import annotations

import json
import xml.etree.ElementTree as ET
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from robot.vision.stereo_rig import StereoRig
from robot.vision.training.true_outlines import Outline, outline_of_mask, outline_of_points
from robot.vision.values import Ripeness

Array = npt.NDArray[np.float64]
Image = npt.NDArray[np.uint8]
Mask = npt.NDArray[np.uint8]


@dataclass(frozen=True, slots=True)
class Sight:
    """A fruit in one view: its whole outline in stored pixels, and the share of it that shows."""

    outline: Outline
    visible_fraction: float


@dataclass(frozen=True, slots=True, eq=False)
class Tomato:
    """``number`` is its value in the masks; ``centre_m`` (3,) in the left camera frame."""

    number: int
    centre_m: Array
    diameter_m: float
    ripeness: Ripeness
    left: Sight
    right: Sight

    @property
    def visible_fraction(self) -> float:
        """The smaller of both views'."""
        return min(self.left.visible_fraction, self.right.visible_fraction)


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """A stereo pair; masks (height, width) hold a fruit's number on its skin, 0 elsewhere, 100 and up on calyx.

    A set whose scenes name no masks has none.
    """

    name: str
    left: Image
    right: Image
    mask_left: Mask | None
    mask_right: Mask | None
    rig: StereoRig
    tomatoes: tuple[Tomato, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Photo:
    """A photograph and its boxes (n, 4) of xmin, ymin, xmax, ymax in pixels."""

    name: str
    image: Image
    boxes: Array


def scenes(folder: Path, only: Collection[str] | None = None) -> Iterator[Scene]:
    """Every ``<id>.json`` of a folder (or ``only`` some ids) with its images, and its masks if there are any.

    ``calib_<rig>.json`` stands there or one above. Raises ``FileNotFoundError`` for what is missing.
    """
    for path in sorted(folder.glob("*.json")):
        if only is not None and path.stem not in only:
            continue
        truth = json.loads(path.read_text(encoding="utf-8"))
        if "tomatoes" not in truth:
            continue
        stem = path.with_suffix("")
        masks = [_mask(Path(f"{stem}_mask_{side}.png")) for side in ("left", "right")]
        yield Scene(
            name=path.stem,
            left=_read(Path(f"{stem}_left.jpg"), cv2.IMREAD_COLOR),
            right=_read(Path(f"{stem}_right.jpg"), cv2.IMREAD_COLOR),
            mask_left=masks[0],
            mask_right=masks[1],
            rig=_rig(folder, truth["rig"]),
            tomatoes=tuple(_tomato(t, masks) for t in truth["tomatoes"]),
        )


def _tomato(t: dict[str, Any], masks: list[Mask | None]) -> Tomato:
    sights = [_sight(t[side], int(t["id"]), mask) for side, mask in zip(("left", "right"), masks, strict=True)]
    return Tomato(
        int(t["id"]),
        np.array(t["centre_m"], dtype=np.float64),
        float(t["diameter_m"]),
        Ripeness(t["ripeness"]),
        sights[0],
        sights[1],
    )


def _sight(view: dict[str, Any], number: int, mask: Mask | None) -> Sight:
    visible = float(view["visible_fraction"])
    if view.get("outline_px"):
        return Sight(outline_of_points(view["outline_px"]), visible)
    skin = np.zeros((1, 1), dtype=bool) if mask is None else mask == number
    return Sight(outline_of_mask(skin, view["bbox_unoccluded"], float(view["unoccluded_area_px"])), visible)


def photos(folder: Path, split: str) -> Iterator[Photo]:
    """The photographs named in ``<split>.txt`` with their PASCAL VOC boxes."""
    for name in (folder / f"{split}.txt").read_text(encoding="utf-8").split():
        root = ET.parse(folder / "annotations" / f"{name}.xml").getroot()
        boxes = [
            [float(box.findtext(key, "nan")) for key in ("xmin", "ymin", "xmax", "ymax")] for box in root.iter("bndbox")
        ]
        yield Photo(name, _read(folder / "images" / f"{name}.jpg", cv2.IMREAD_COLOR), np.array(boxes).reshape(-1, 4))


def _mask(path: Path) -> Mask | None:
    return _read(path, cv2.IMREAD_GRAYSCALE) if path.exists() else None


def _read(path: Path, mode: int) -> Image:
    image = cv2.imread(str(path), mode)
    if image is None:
        raise FileNotFoundError(f"expected an image at {path}, found none that can be read; check the data folder")
    return np.asarray(image, dtype=np.uint8)


def _rig(folder: Path, name: str) -> StereoRig:
    for place in (folder, folder.parent):
        path = place / f"calib_{name}.json"
        if path.exists():
            data = json.loads(path.read_text(encoding="utf-8"))
            names = ("K_left", "K_right", "dist_left", "dist_right", "R", "t_m")
            arrays = {name: np.array(data[name], dtype=np.float64) for name in names}
            width, height = data["image_size"]
            return StereoRig((int(width), int(height)), **arrays)
    raise FileNotFoundError(f"expected calib_{name}.json in {folder} or {folder.parent}, found none")

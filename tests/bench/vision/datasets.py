"""The sets on disk: rendered greenhouse scenes and photographs, beside the project or where SPRAYER_SHARED says."""

from __future__ import annotations

import json
import math
import os
import xml.etree.ElementTree as ET
from functools import cache, partial
from pathlib import Path

import numpy as np

from robot.calibration_file import load_rig
from robot.image_folder import read_image
from tests.bench.vision.labelled import (
    Photo,
    PhotoSet,
    SceneFacts,
    StereoScene,
    StereoSet,
    TrueFruit,
    light_percent,
)

SHARED = Path(os.environ.get("SPRAYER_SHARED", Path(__file__).parents[4] / "shared"))
GREENHOUSE = SHARED / "data" / "greenhouse"
PHOTOS = SHARED / "data" / "tomato_photos"
ABSENT = "not found at {}: put it beside the project or set SPRAYER_SHARED"


def greenhouse(split: str) -> StereoSet | None:
    """The rendered scenes of ``dev`` or ``train``; None when the set is not there."""
    folder = GREENHOUSE / split
    if not folder.is_dir():
        return None
    names = tuple(sorted(path.stem for path in folder.glob(f"{split}_*.json")))
    return StereoSet(f"greenhouse_{split}", f"rendered greenhouse, {split}", names, partial(_scene, folder))


def photographs(split: str) -> PhotoSet | None:
    """The photographs of ``val`` or ``train``; None when the set is not there."""
    listing = PHOTOS / f"{split}.txt"
    if not listing.is_file():
        return None
    names = tuple(sorted(listing.read_text(encoding="utf-8").split()))
    return PhotoSet(f"photos_{split}", f"photographs, {split}", names, _photo)


def _scene(folder: Path, name: str) -> StereoScene:
    truth = json.loads((folder / f"{name}.json").read_text(encoding="utf-8"))
    left = read_image(folder / f"{name}_left.jpg")
    facts = SceneFacts(
        name=name,
        hour=int(truth["hour"]),
        lamp=bool(truth["lamp"]),
        weather=str(truth["weather"]),
        rig=str(truth["rig"]),
        light_percent=light_percent(left),
    )
    fruits = tuple(
        TrueFruit(
            id=int(fruit["id"]),
            centre_m=np.array(fruit["centre_m"], dtype=np.float64),
            diameter_m=float(fruit["diameter_m"]),
            ripeness=str(fruit["ripeness"]),
            visible_fraction=float(fruit["visible_fraction_min"]),
            left_px=(*fruit["left"]["centre_px"], math.sqrt(fruit["left"]["unoccluded_area_px"] / math.pi)),
            touching=bool(fruit["touching_ids"]),
        )
        for fruit in truth["tomatoes"]
    )
    calibration = folder / str(truth["calib_file"])
    rig = _rig(calibration if calibration.exists() else folder.parent / calibration.name)
    return StereoScene(facts, left, read_image(folder / f"{name}_right.jpg"), rig, fruits)


_rig = cache(load_rig)


def _photo(name: str) -> Photo:
    root = ET.parse(PHOTOS / "annotations" / f"{name}.xml").getroot()
    keys = ("xmin", "ymin", "xmax", "ymax")
    boxes = [[float(box.findtext(key, "nan")) for key in keys] for box in root.iter("bndbox")]
    image = read_image(PHOTOS / "images" / f"{name}.jpg")
    return Photo(name, image, np.array(boxes, dtype=np.float64).reshape(-1, 4))

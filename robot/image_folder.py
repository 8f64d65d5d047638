"""Images on disk: stereo pairs and single photos."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from robot.errors import FileError

Image = npt.NDArray[np.uint8]

_SUFFIXES = (".jpg", ".jpeg", ".png", ".bmp", ".tif", ".tiff", ".ppm", ".pgm", ".webp")
_SIDE = re.compile(r"^(?P<id>.+)_(?P<side>left|right)$", re.IGNORECASE)
_NOT_A_PHOTO = re.compile(r"(^|_)(mask|depth|disparity)(_|$)", re.IGNORECASE)


@dataclass(frozen=True, slots=True)
class ImagePair:
    """The files ``<scene_id>_left.*`` and ``<scene_id>_right.*``; ``sidecar`` is the place of ``<scene_id>.json``."""

    scene_id: str
    left: Path
    right: Path

    @property
    def sidecar(self) -> Path:
        return self.left.parent / f"{self.scene_id}.json"


def find_pairs(folder: Path) -> list[ImagePair]:
    """The stereo pairs of a folder by scene id; masks, depth and disparity images are none.

    Raises ``FileError`` for a folder without pairs, an image without its partner, or two images for one side.
    """
    sides: dict[tuple[str, str], Path] = {}
    for path in _photos(folder):
        match = _SIDE.match(path.stem)
        if match is None:
            continue
        key = (match["id"], match["side"].lower())
        if key in sides:
            raise FileError(f"{path}: there is also {sides[key].name} for the same side; keep one of the two")
        sides[key] = path
    for (scene_id, side), path in sides.items():
        other = "right" if side == "left" else "left"
        if (scene_id, other) not in sides:
            raise FileError(
                f"{path}: its partner {scene_id}_{other}{path.suffix} is missing; add it or take {path.name} away"
            )
    if not sides:
        raise FileError(f"{folder}: no pairs named <id>_left.* and <id>_right.* here; give the folder that holds them")
    scene_ids = [scene_id for scene_id, side in sides if side == "left"]
    return [ImagePair(scene_id, sides[scene_id, "left"], sides[scene_id, "right"]) for scene_id in scene_ids]


def find_images(folder: Path) -> list[Path]:
    """The photos of a folder by name; masks, depth and disparity images are none. ``FileError`` when there is none."""
    photos = _photos(folder)
    if not photos:
        raise FileError(f"{folder}: no images ({' '.join(_SUFFIXES)}) here; give the folder that holds them")
    return photos


def read_image(path: Path) -> Image:
    """(height, width, 3) BGR, pixels as stored (an EXIF orientation is not applied).

    Raises ``FileError`` when the file is missing, cut off or no image.
    """
    return _read(path, cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION)


def read_grey_image(path: Path) -> Image:
    """(height, width), pixels as stored; errors as ``read_image``."""
    return _read(path, cv2.IMREAD_GRAYSCALE | cv2.IMREAD_IGNORE_ORIENTATION)


def size_text(image: Image) -> str:
    """Width by height, such as 640x480."""
    return f"{image.shape[1]}x{image.shape[0]}"


def _photos(folder: Path) -> list[Path]:
    try:
        entries = sorted(folder.iterdir())
    except OSError as error:
        raise FileError(f"{folder}: cannot be read as a folder ({error.strerror}); give a folder of images") from error
    return [
        path
        for path in entries
        if path.suffix.lower() in _SUFFIXES and not path.name.startswith(".") and not _NOT_A_PHOTO.search(path.stem)
    ]


def _read(path: Path, flags: int) -> Image:
    try:
        data = path.read_bytes()
    except OSError as error:
        raise FileError(f"{path}: cannot be read ({error.strerror}); check the file and its permissions") from error
    if _cut_off(data):
        raise FileError(f"{path}: the image is cut off after {len(data)} bytes; copy it again or take it away")
    try:
        image = cv2.imdecode(np.frombuffer(data, dtype=np.uint8), flags) if data else None
    except cv2.error:
        image = None
    if image is None:
        raise FileError(f"{path}: cannot be decoded as an image; replace it or take it away")
    return np.asarray(image, dtype=np.uint8)


def _cut_off(data: bytes) -> bool:
    """Whether a JPEG lacks its last scan's end marker, or a PNG its end chunk (decoders fill in grey for either)."""
    if data.startswith(b"\xff\xd8"):
        return data.rfind(b"\xff\xd9") < data.rfind(b"\xff\xda")
    if data.startswith(b"\x89PNG\r\n\x1a\n"):
        return b"IEND" not in data[-64:]
    return False

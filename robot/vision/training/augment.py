"""The same picture as another camera at another place, hour and distance would have taken it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from robot.vision.fruit.proposer_input import normalised
from robot.vision.training.views import CALYX, View

Array = npt.NDArray[np.float64]
Plane = npt.NDArray[np.float32]

SIZE = (320, 240)
GAMMA = 2.2
SCALES, PHOTO_SCALES = (0.65, 1.6), (0.6, 2.0)


@dataclass(frozen=True, slots=True, eq=False)
class Example:
    """A network's input (3, h, w), and the fruit in it: ``boxes`` (n, 4) in its pixels, ``visible`` and ``ripeness``.

    ``border`` (4,) is the rectangle at which the boxes are cut off; ``skin`` (h, w) share of skin, or None.
    """

    planes: Plane
    boxes: Array
    visible: Array
    ripeness: Array
    border: Array
    skin: Plane | None


def augmented(view: View, generator: np.random.Generator) -> Example:
    """Another scale, place, side, light, colour, noise and sharpness. A drawn picture of SIZE."""
    height, width = view.image.shape[:2]
    base = SIZE[0] / max(width, height)
    smallest, largest = SCALES if view.whole else PHOTO_SCALES
    scale = base * float(np.exp(generator.uniform(np.log(smallest), np.log(largest))))
    size = (max(16, round(width * scale)), max(16, round(height * scale)))
    factor = np.array([size[0] / width, size[1] / height])
    image = cv2.resize(view.image, size, interpolation=cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR)
    shift = _place(size, view, factor, generator)
    picture = _framed(image, shift, int(generator.integers(0, 256)))
    boxes = (view.boxes.reshape(-1, 2, 2) + 0.5) * factor - 0.5 - shift
    border = (np.array([[0.0, 0.0], [width, height]])) * factor - 0.5 - shift
    skin = None
    if view.mask is not None:
        share = cv2.resize(
            ((view.mask > 0) & (view.mask < CALYX)).astype(np.float32), size, interpolation=cv2.INTER_AREA
        )
        skin = _framed(share, shift, 0)
    if generator.random() < 0.5:
        picture, skin = picture[:, ::-1], None if skin is None else skin[:, ::-1]
        boxes, border = _mirrored(boxes), _mirrored(border[None])[0]
    light = _other_light(np.ascontiguousarray(picture), generator)
    planes = np.ascontiguousarray(normalised(light).transpose(2, 0, 1))
    if view.whole:
        border = np.array([[-1e4, -1e4], [1e4, 1e4]])
    return Example(planes, boxes.reshape(-1, 4), view.visible, view.ripeness, border.ravel(), skin)


def plain(view: View) -> Example:
    """The picture as the detector sees it."""
    height, width = view.image.shape[:2]
    scale = SIZE[0] / max(width, height)
    size = (round(width * scale), round(height * scale))
    image = np.asarray(cv2.resize(view.image, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)
    factor = np.array([size[0] / width, size[1] / height])
    boxes = (view.boxes.reshape(-1, 2, 2) + 0.5) * factor - 0.5
    border = np.array([0.0, 0.0, *size]) - 0.5
    planes = np.ascontiguousarray(normalised(image).transpose(2, 0, 1))
    return Example(planes, boxes.reshape(-1, 4), view.visible, view.ripeness, border, None)


def _place(size: tuple[int, int], view: View, factor: Array, generator: np.random.Generator) -> Array:
    """Where the drawn frame stands in the scaled picture; mostly such that a fruit is in it."""
    room = np.array(size) - np.array(SIZE)
    if len(view.boxes) and generator.random() < 0.7:
        box = view.boxes[int(generator.integers(len(view.boxes)))].reshape(2, 2).mean(axis=0) * factor
        wanted = box - np.array(SIZE) * generator.uniform(0.1, 0.9, 2)
    else:
        wanted = room * generator.uniform(0.0, 1.0, 2)
    low, high = np.minimum(room, 0), np.maximum(room, 0)
    return np.asarray(np.rint(np.clip(wanted, low, high)))


def _framed(image: npt.NDArray[Any], shift: Array, fill: int) -> npt.NDArray[Any]:
    """The part of the image at ``shift``, of SIZE; outside of the image ``fill``."""
    left, top = (int(value) for value in shift)
    out = np.full((SIZE[1], SIZE[0], *image.shape[2:]), fill, dtype=image.dtype)
    source = image[max(top, 0) : top + SIZE[1], max(left, 0) : left + SIZE[0]]
    row, column = max(-top, 0), max(-left, 0)
    out[row : row + source.shape[0], column : column + source.shape[1]] = source
    return out


def _mirrored(boxes: Array) -> Array:
    out = boxes.copy()
    out[:, :, 0] = SIZE[0] - 1 - boxes[:, ::-1, 0]
    return out


def _other_light(picture: npt.NDArray[Any], generator: np.random.Generator) -> npt.NDArray[np.uint8]:
    """Colour temperature, exposure, gamma, blur, noise of a dark picture, 8 bits."""
    light = (picture.astype(np.float32) / 255.0) ** GAMMA
    if generator.random() < 0.7:
        light *= np.exp(generator.normal(0.0, 0.12, 3)).astype(np.float32)
    if generator.random() < 0.3:
        light = _other_hue(light, generator)
    gain = np.exp(generator.normal(0.0, 0.35))
    dark = generator.random() < 0.3
    if dark:
        gain *= np.exp(-generator.uniform(0.5, 4.0))
    light *= np.float32(gain)
    if generator.random() < 0.2:
        light = np.asarray(cv2.GaussianBlur(light, (0, 0), float(generator.uniform(0.3, 1.2))))
    read, shot = (0.0008, 0.01) if not dark else (generator.uniform(0.0003, 0.0016), 0.012)
    noise = generator.standard_normal(light.shape, dtype=np.float32)
    light += noise * np.sqrt(np.float32(read) ** 2 + np.float32(shot) ** 2 * np.maximum(light, 0.0) * 0.25)
    code = np.clip(light, 0.0, 1.0) ** np.float32(generator.uniform(0.9, 1.1) / GAMMA)
    if generator.random() < 0.5:
        contrast = np.float32(generator.uniform(0.8, 1.25))
        code = np.clip((code - code.mean()) * contrast + code.mean(), 0.0, 1.0)
    out = np.asarray(np.rint(code * 255.0), dtype=np.uint8)
    if generator.random() < 0.3:
        _, data = cv2.imencode(".jpg", out, [cv2.IMWRITE_JPEG_QUALITY, int(generator.integers(50, 95))])
        out = np.asarray(cv2.imdecode(data, cv2.IMREAD_COLOR), dtype=np.uint8)
    return out


def _other_hue(light: Plane, generator: np.random.Generator) -> Plane:
    """A little more or less saturation."""
    grey = light.mean(axis=2, keepdims=True)
    return np.asarray(np.maximum(grey + (light - grey) * np.float32(generator.uniform(0.75, 1.3)), 0.0))

"""Runs the proposing network over pictures."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from robot.vision.fruit.proposals import Proposals, proposals_of
from robot.vision.fruit.proposer_input import normalised

Image = npt.NDArray[np.uint8]
Plane = npt.NDArray[np.float32]

LONG_SIDE_PX = 320
MULTIPLE = 16


@dataclass(frozen=True, slots=True, eq=False)
class Prepared:
    """Pictures of one size as the network takes them (n, 3, h, w), with ``scale`` (2,) stored pixels a pixel of it."""

    planes: Plane
    scale: npt.NDArray[np.float64]


def prepare(*images: Image) -> Prepared:
    """(height, width, 3) BGR pictures of one size, averaged down so that the long side is at most LONG_SIDE_PX."""
    height, width = images[0].shape[:2]
    reduction = max(1.0, max(height, width) / LONG_SIDE_PX)
    size = (max(1, round(width / reduction)), max(1, round(height / reduction)))
    padded = (-(-size[1] // MULTIPLE) * MULTIPLE, -(-size[0] // MULTIPLE) * MULTIPLE)
    planes = np.zeros((len(images), 3, *padded), dtype=np.float32)
    for k, image in enumerate(images):
        planes[k, :, : size[1], : size[0]] = normalised(_averaged(image, size)).transpose(2, 0, 1)
    return Prepared(planes, np.array([width / size[0], height / size[1]]))


def _averaged(image: Image, size: tuple[int, int]) -> Image:
    """Averaged down to ``size``, in halves as far as they go: twice as fast as in one step."""
    while image.shape[1] % (2 * size[0]) == 0 == image.shape[0] % (2 * size[1]):
        half = (image.shape[1] // 2, image.shape[0] // 2)
        image = np.asarray(cv2.resize(image, half, interpolation=cv2.INTER_AREA), dtype=np.uint8)
    if (image.shape[1], image.shape[0]) == size:
        return image
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)


def propose(prepared: Prepared, net: cv2.dnn.Net, least_chance: float, most: int) -> list[Proposals]:
    """Fruit of each picture, boxes in stored pixels."""
    net.setInput(prepared.planes)
    answer = np.asarray(net.forward(), dtype=np.float32)
    return [_in_stored(proposals_of(view, least_chance, most), prepared.scale) for view in answer]


def _in_stored(found: Proposals, scale: npt.NDArray[np.float64]) -> Proposals:
    boxes = found.boxes.copy()
    boxes[:, :2] = (boxes[:, :2] + 0.5) * scale - 0.5
    boxes[:, 2:] *= scale
    return Proposals(boxes, found.chance, found.visible, found.ripeness)

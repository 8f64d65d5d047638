"""The proposing network's answer as fruit of one picture."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

Plane = npt.NDArray[np.float32]
Array = npt.NDArray[np.float64]

STRIDE = 4
REFERENCE_PX = 32.0
"""A cell of the answer is STRIDE pixels of the network's input; sizes are said relative to REFERENCE_PX of it."""
SAME_OVERLAP = 0.45


@dataclass(frozen=True, slots=True, eq=False)
class Proposals:
    """n fruit, most likely first: ``boxes`` (n, 4) centre u and v, width and height of the whole fruit in pixels;
    ``chance`` (n,) that it is one, ``visible`` (n,) share and ``ripeness`` (n,), 0 green to 1 red.
    """

    boxes: Array
    chance: Array
    visible: Array
    ripeness: Array

    def __len__(self) -> int:
        return len(self.chance)

    def __getitem__(self, rows: npt.NDArray[np.int64]) -> Proposals:
        """Some of them."""
        return Proposals(self.boxes[rows], self.chance[rows], self.visible[rows], self.ripeness[rows])


def proposals_of(answer: Plane, least_chance: float, most: int) -> Proposals:
    """Local maxima of an answer (7, h, w), at most ``most``, of overlapping ones the likeliest."""
    heat = np.ascontiguousarray(answer[0])
    top = cv2.dilate(heat, np.ones((3, 3), np.uint8))
    logit = np.log(least_chance / (1.0 - least_chance))
    rows, columns = np.nonzero((heat >= top) & (heat > logit))
    order = np.argsort(-heat[rows, columns], kind="stable")[: 4 * most]
    rows, columns = rows[order], columns[order]
    said = answer[:, rows, columns].astype(np.float64)
    boxes = np.column_stack(
        [
            (columns + 0.5 + np.clip(said[1], -8.0, 8.0)) * STRIDE - 0.5,
            (rows + 0.5 + np.clip(said[2], -8.0, 8.0)) * STRIDE - 0.5,
            REFERENCE_PX * np.exp(np.clip(said[3], -3.0, 3.0)),
            REFERENCE_PX * np.exp(np.clip(said[4], -3.0, 3.0)),
        ]
    )
    found = Proposals(boxes, _sigmoid(said[0]), _sigmoid(said[5]), _sigmoid(said[6]))
    return found[_apart(found.boxes, most)]


def _sigmoid(logit: Array) -> Array:
    return np.asarray(0.5 * (1.0 + np.tanh(0.5 * logit)))


def overlaps(boxes: Array, other: Array) -> Array:
    """(n, m) intersection over union of boxes (n, 4) and (m, 4) of centre, width and height."""
    low = np.maximum((boxes[:, :2] - boxes[:, 2:] / 2)[:, None], (other[:, :2] - other[:, 2:] / 2)[None])
    high = np.minimum((boxes[:, :2] + boxes[:, 2:] / 2)[:, None], (other[:, :2] + other[:, 2:] / 2)[None])
    shared = np.clip(high - low, 0.0, None).prod(axis=2)
    return np.asarray(shared / (boxes[:, 2:].prod(axis=1)[:, None] + other[:, 2:].prod(axis=1)[None] - shared))


def _apart(boxes: Array, most: int) -> npt.NDArray[np.int64]:
    """Rows in their order that overlap no better one, at most ``most``."""
    kept: list[int] = []
    shared = overlaps(boxes, boxes)
    for row in range(len(boxes)):
        if not kept or shared[row, kept].max() < SAME_OVERLAP:
            kept.append(row)
            if len(kept) == most:
                break
    return np.array(kept, dtype=np.int64)

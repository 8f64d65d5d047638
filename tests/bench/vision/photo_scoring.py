"""Circles against the boxes of photographs.

A circle stands for the square round it, clipped to the photograph. It is a hit at an overlap (IoU) of 0.5 with a box,
greedily by confidence, each box once. Boxes under 40 px are neither hit nor miss, and neither is a circle whose best
box is such a one or that is under 32 px wide.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal

from robot.vision.values import Circle
from tests.bench.vision.labelled import Photo, light_percent

MIN_SIDE_PX, MIN_CIRCLE_PX, MIN_IOU, SMALL_IOU = 40.0, 32.0, 0.5, 0.3
_APART_IOU, _BORDER_PX = 0.02, 2.0

Box = tuple[float, float, float, float]
Fate = Literal["hit", "false alarm", "ignored"]


@dataclass(frozen=True, slots=True)
class BoxFate:
    """A box that counts, by what its results are sorted, and whether it was hit."""

    box: Box
    groups: tuple[tuple[str, str], ...]
    hit: bool


@dataclass(frozen=True, slots=True)
class JudgedPhoto:
    """``circles`` in order of confidence with what became of each; ``boxes`` that count."""

    name: str
    circles: tuple[tuple[Circle, Fate], ...]
    boxes: tuple[BoxFate, ...]


@dataclass(frozen=True, slots=True)
class PhotoScore:
    """Over the boxes that count."""

    photos: int
    boxes: int
    counted_circles: int
    hits: int
    recall: float
    precision: float
    f1: float
    ap50: float


def judge_photo(photo: Photo, circles: Sequence[Circle]) -> JudgedPhoto:
    """One photograph."""
    height, width = photo.image.shape[:2]
    boxes: list[Box] = [(float(b[0]), float(b[1]), float(b[2]), float(b[3])) for b in photo.boxes]
    big = {k for k, box in enumerate(boxes) if _side(box) >= MIN_SIDE_PX}
    taken: set[int] = set()
    fates: list[tuple[Circle, Fate]] = []
    for circle in sorted(circles, key=lambda circle: -circle.confidence):
        square = _square(circle, width, height)
        fate: Fate = "false alarm"
        if square is not None:
            free = ((iou(square, box), k) for k, box in enumerate(boxes) if k not in taken)
            best, k = max(free, default=(0.0, -1))
            if best >= MIN_IOU and k in big:
                taken.add(k)
                fate = "hit"
            elif (best >= SMALL_IOU and k not in big) or 2.0 * circle.r_px < MIN_CIRCLE_PX:
                fate = "ignored"
        fates.append((circle, fate))
    light = _light_group(light_percent(photo.image))
    judged = tuple(BoxFate(boxes[k], (*_groups(boxes, k, width, height), light), k in taken) for k in sorted(big))
    return JudgedPhoto(photo.name, tuple(fates), judged)


def photo_score(photos: Sequence[JudgedPhoto]) -> PhotoScore:
    """Recall, precision, F1 and average precision over photographs."""
    ranked = sorted(
        ((circle.confidence, fate == "hit") for photo in photos for circle, fate in photo.circles if fate != "ignored"),
        key=lambda row: -row[0],
    )
    boxes = sum(len(photo.boxes) for photo in photos)
    hits = sum(hit for _, hit in ranked)
    recall, precision = hits / max(1, boxes), hits / max(1, len(ranked))
    f1 = 2.0 * precision * recall / max(1e-9, precision + recall)
    ap50 = _average_precision([hit for _, hit in ranked], boxes)
    return PhotoScore(len(photos), boxes, len(ranked), hits, recall, precision, f1, ap50)


def recall_by_group(photos: Iterable[JudgedPhoto]) -> dict[str, dict[str, tuple[int, int]]]:
    """Group by grouping: hit and all boxes."""
    out: dict[str, dict[str, tuple[int, int]]] = {}
    for photo in photos:
        for fate in photo.boxes:
            for grouping, name in fate.groups:
                hits, count = out.setdefault(grouping, {}).get(name, (0, 0))
                out[grouping][name] = (hits + fate.hit, count + 1)
    return {grouping: dict(sorted(rows.items())) for grouping, rows in out.items()}


def iou(one: Box, other: Box) -> float:
    """Shared over united area."""
    across = min(one[2], other[2]) - max(one[0], other[0])
    down = min(one[3], other[3]) - max(one[1], other[1])
    shared = max(0.0, across) * max(0.0, down)
    return shared / (_area(one) + _area(other) - shared) if shared else 0.0


def _average_precision(hits: Sequence[bool], boxes: int) -> float:
    """Area under precision over recall, each precision the best at that recall or more.

    The steps run from the last recall to the first; the part before the first recall counts at the overall best.
    """
    found, curve = 0, []
    for rank, hit in enumerate(hits, 1):
        found += hit
        curve.append((found / max(1, boxes), found / rank))
    area, best = 0.0, 0.0
    for k in range(len(curve) - 1, -1, -1):
        best = max(best, curve[k][1])
        before = curve[k - 1][0] if k else 0.0
        area += (curve[k][0] - before) * best
    return area


def _groups(boxes: Sequence[Box], k: int, width: int, height: int) -> tuple[tuple[str, str], ...]:
    box, side = boxes[k], _side(boxes[k])
    near = _BORDER_PX
    cut = box[0] <= near or box[1] <= near or box[2] >= width - near or box[3] >= height - near
    touches = any(iou(box, other) > _APART_IOU for j, other in enumerate(boxes) if j != k)
    return (
        ("size", "size 40-64 px" if side < 64.0 else "size 64-100 px" if side < 100.0 else "size > 100 px"),
        ("border", "cut by border" if cut else "inside"),
        ("crowding", "touches another" if touches else "alone"),
    )


def _light_group(percent: float) -> tuple[str, str]:
    return ("light", "dark photo (< 15 %)" if percent < 15.0 else "light photo")


def _square(circle: Circle, width: int, height: int) -> Box | None:
    u, v, r = circle.u_px, circle.v_px, circle.r_px
    square = (max(0.0, u - r), max(0.0, v - r), min(float(width), u + r), min(float(height), v + r))
    return square if square[2] > square[0] and square[3] > square[1] else None


def _side(box: Box) -> float:
    return max(box[2] - box[0], box[3] - box[1])


def _area(box: Box) -> float:
    return (box[2] - box[0]) * (box[3] - box[1])

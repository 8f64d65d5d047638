"""Pictures of hits, misses and false alarms."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from robot.vision.values import Circle
from tests.bench.vision.contestants import Key
from tests.bench.vision.labelled import Image
from tests.bench.vision.photo_scoring import JudgedPhoto
from tests.bench.vision.results import PhotoResult, StereoResult
from tests.bench.vision.scoring import Detection, Sighting

Uvr = tuple[float, float, float]

HITS, MISSES, ALARMS = 5, 10, 10
_SIDE_PX, _QUALITY = 232, 82
_WHITE, _DARK, _BLUE, _ORANGE, _PINK = (255, 255, 255), (30, 30, 30), (255, 150, 40), (0, 140, 255), (200, 80, 255)
_DIM_CODE, _BRIGHT_CODE = 110.0, 225.0


@dataclass(frozen=True, slots=True)
class Picture:
    """``kind``: hit, miss, false alarm, or photo."""

    kind: str
    caption: str
    data_uri: str


def scene_pictures(result: StereoResult, key: Key) -> tuple[Picture, ...]:
    """Hits from all hours, the misses that show most, the surest false alarms."""
    judged = result.judged(key)
    hits = [s for s in judged.sightings if s.found is not None]
    hits = sorted(hits, key=lambda s: (s.scene.hour, s.scene.lamp, s.scene.name))
    misses = sorted(
        (s for s in judged.sightings if s.found is None), key=lambda s: (-s.truth.visible_fraction, s.scene.name)
    )
    alarms = sorted((d for d in judged.detections if not d.real), key=lambda d: (-d.fruit.confidence, d.scene.name))
    chosen: list[Sighting | Detection] = [*_even(hits, HITS), *misses[:MISSES], *alarms[:ALARMS]]
    return tuple(_crop(result, judged.sightings, judged.detections, one) for one in chosen)


def photo_pictures(result: PhotoResult, key: Key) -> tuple[Picture, ...]:
    """The photographs with the most hits, the most misses and the most false alarms."""
    judged = result.judged[key]

    def hits(photo: JudgedPhoto) -> int:
        return sum(box.hit for box in photo.boxes)

    def misses(photo: JudgedPhoto) -> int:
        return len(photo.boxes) - hits(photo)

    def alarms(photo: JudgedPhoto) -> int:
        return sum(fate == "false alarm" for _, fate in photo.circles)

    chosen = {max(judged, key=count).name: count for count in (hits, misses, alarms)}
    return tuple(
        Picture(
            "photo",
            f"{photo.name}: {hits(photo)} hits, {misses(photo)} misses, {alarms(photo)} false alarms",
            _uri(_drawn_photo(result.pictures.load(photo.name).image, photo)),
        )
        for photo in judged
        if photo.name in chosen
    )


def _crop(
    result: StereoResult, sightings: Sequence[Sighting], detections: Sequence[Detection], one: Sighting | Detection
) -> Picture:
    scene = result.pictures.load(one.scene.name)
    if isinstance(one, Sighting):
        u, v, r = one.truth.left_px
        kind = "miss" if one.found is None else "hit"
        about = (
            f"{one.truth.ripeness}, {100 * one.truth.diameter_m:.1f} cm at {one.truth.centre_m[2]:.2f} m, "
            f"{100 * one.truth.visible_fraction:.0f} % visible"
        )
        if one.error_m is not None:
            about += f"; off by {1e3 * np.linalg.norm(one.error_m):.1f} mm, {100 * (one.diameter_error or 0.0):+.1f} %"
    else:
        fruit = one.fruit
        u, v, r = _uvr(fruit.left)
        kind = "false alarm"
        about = f"confidence {fruit.confidence:.2f}, {100 * fruit.diameter_m:.1f} cm at {fruit.centre_m[2]:.2f} m"
    image, gain = _brightened(scene.left)
    reach = max(48.0, 2.4 * r)
    scale = _SIDE_PX / (2.0 * reach)
    move = np.array([[scale, 0.0, scale * (reach - u)], [0.0, scale, scale * (reach - v)]])
    crop = np.asarray(
        cv2.warpAffine(image, move, (_SIDE_PX, _SIDE_PX), flags=cv2.INTER_LINEAR, borderValue=(235, 235, 235)),
        dtype=np.uint8,
    )
    for truth in scene.fruits:
        _ring(crop, move, truth.left_px, _WHITE, 1)
    for detection in detections:
        if detection.scene.name == one.scene.name:
            _ring(crop, move, _uvr(detection.fruit.left), _BLUE if detection.real else _ORANGE, 2)
    for sighting in sightings:
        if sighting.scene.name == one.scene.name and sighting.found is None:
            _ring(crop, move, sighting.truth.left_px, _PINK, 2)
    hour = f"{one.scene.hour} h{' with lamp' if one.scene.lamp else ''}"
    bright = f", brightened {gain:.0f} times" if gain > 1.0 else ""
    return Picture(kind, f"{one.scene.name}, {hour}: {about}{bright}", _uri(crop))


def _brightened(image: Image) -> tuple[Image, float]:
    """For the eye: a picture whose lights are dim is scaled up."""
    light = float(np.percentile(image, 99.0))
    if light >= _DIM_CODE:
        return image, 1.0
    gain = _BRIGHT_CODE / max(light, 1.0)
    return np.asarray(cv2.convertScaleAbs(image, alpha=gain), dtype=np.uint8), gain


def _ring(image: Image, move: npt.NDArray[np.float64], circle: Uvr, colour: tuple[int, int, int], px: int) -> None:
    u, v, r = circle
    if not np.isfinite([u, v, r]).all():
        return
    centre = move @ np.array([u, v, 1.0])
    place, radius = (round(float(centre[0])), round(float(centre[1]))), max(1, round(float(move[0, 0]) * r))
    cv2.circle(image, place, radius, _DARK, px + 2, cv2.LINE_AA)
    cv2.circle(image, place, radius, colour, px, cv2.LINE_AA)


def _drawn_photo(image: Image, judged: JudgedPhoto) -> Image:
    out, _ = _brightened(image)
    out = out.copy()
    for fate in judged.boxes:
        x0, y0, x1, y1 = (round(edge) for edge in fate.box)
        cv2.rectangle(out, (x0, y0), (x1, y1), _DARK, 3)
        cv2.rectangle(out, (x0, y0), (x1, y1), _WHITE if fate.hit else _PINK, 1)
    for circle, what in judged.circles:
        if what != "ignored":
            _ring(out, np.eye(2, 3), _uvr(circle), _BLUE if what == "hit" else _ORANGE, 2)
    return out


def _uvr(circle: Circle) -> Uvr:
    return circle.u_px, circle.v_px, circle.r_px


def _even(items: Sequence[Sighting], count: int) -> list[Sighting]:
    if len(items) <= count:
        return list(items)
    return [items[k * (len(items) - 1) // (count - 1)] for k in range(count)]


def _uri(image: Image) -> str:
    data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])[1]
    return "data:image/jpeg;base64," + base64.b64encode(data.tobytes()).decode("ascii")

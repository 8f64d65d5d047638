"""Fruit drawn onto an image."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
import numpy.typing as npt

from robot.vision.paper import sphere_volume_m3
from robot.vision.values import Circle, Fruit, Ripeness

Image = npt.NDArray[np.uint8]

_COLOUR_BGR = {Ripeness.RED: (60, 60, 255), Ripeness.TURNING: (0, 190, 255), Ripeness.GREEN: (90, 255, 90)}
_DARK, _LIGHT = (25, 25, 25), (255, 255, 255)
_FONT, _FONT_SCALE, _GAP_PX = cv2.FONT_HERSHEY_SIMPLEX, 0.38, 3


def draw_fruits(image: Image, fruits: Sequence[Fruit], target_ids: Sequence[int] = ()) -> Image:
    """A copy of the left BGR image with each fruit's outline, size and range, and its target's number when given.

    A size that was not measured stands after "~".
    """
    if target_ids and len(target_ids) != len(fruits):
        raise ValueError(f"need one target id a fruit, found {len(target_ids)} for {len(fruits)} fruit")
    out = image.copy()
    for fruit in fruits:
        _draw_circle(out, fruit.left)
    for index, fruit in enumerate(fruits):  # labels last: no circle runs through them
        number = f"#{target_ids[index]} " if target_ids else ""
        about = "" if fruit.measured else "~"
        size = f"{number}{about}{fruit.diameter_m * 1e3:.0f} mm {sphere_volume_m3(fruit.diameter_m) * 1e6:.0f} cm3"
        _draw_label(out, fruit.left, f"{size} {float(np.linalg.norm(fruit.centre_m)):.2f} m")
    return out


def draw_circles(image: Image, circles: Sequence[Circle]) -> Image:
    """A copy of the BGR image with each circle and its confidence."""
    out = image.copy()
    for circle in circles:
        _draw_circle(out, circle)
    for circle in circles:
        _draw_label(out, circle, f"{circle.confidence:.2f}")
    return out


def _draw_circle(image: Image, circle: Circle) -> None:
    centre, radius = (round(circle.u_px), round(circle.v_px)), max(1, round(circle.r_px))
    for colour, thickness in ((_DARK, 4), (_COLOUR_BGR[circle.ripeness], 2)):
        cv2.circle(image, centre, radius, colour, thickness, cv2.LINE_AA)


def _draw_label(image: Image, circle: Circle, text: str) -> None:
    """White on a dark plate under the circle, or over it where the image ends."""
    height_px, width_px = image.shape[:2]
    (text_width, text_height), descent = cv2.getTextSize(text, _FONT, _FONT_SCALE, 1)
    plate_width, plate_height = text_width + 2 * _GAP_PX, text_height + descent + _GAP_PX
    left = round(circle.u_px) - plate_width // 2
    top = round(circle.v_px + circle.r_px) + _GAP_PX
    if top + plate_height > height_px:
        top = round(circle.v_px - circle.r_px) - _GAP_PX - plate_height
    left = max(0, min(left, width_px - plate_width))
    top = max(0, min(top, height_px - plate_height))
    cv2.rectangle(image, (left, top), (left + plate_width, top + plate_height), _DARK, cv2.FILLED)
    base = (left + _GAP_PX, top + text_height + _GAP_PX)
    cv2.putText(image, text, base, _FONT, _FONT_SCALE, _LIGHT, 1, cv2.LINE_AA)

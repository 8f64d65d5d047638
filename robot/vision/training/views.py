"""Single pictures with what the proposer should find in them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from robot.vision.training.labelled import Image, Mask, Photo, Scene
from robot.vision.values import Ripeness

Array = npt.NDArray[np.float64]
RIPENESS_SCORE = {Ripeness.GREEN: 0.0, Ripeness.TURNING: 0.5, Ripeness.RED: 1.0}
CALYX = 100


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """A picture and its n fruit.

    ``boxes`` (n, 4) left, top, right, bottom in pixels; ``visible`` (n,) and ``ripeness`` (n,), nan where nobody says;
    ``whole``: boxes are of the whole fruit, beyond the picture's border too; otherwise they are cut off there.
    ``mask`` as in ``Scene``, or None.
    """

    image: Image
    boxes: Array
    visible: Array
    ripeness: Array
    whole: bool
    mask: Mask | None


def views_of_scenes(found: Iterable[Scene]) -> Iterator[View]:
    """Both views of every scene."""
    for scene in found:
        for side, image, mask in (("left", scene.left, scene.mask_left), ("right", scene.right, scene.mask_right)):
            sights = [getattr(tomato, side) for tomato in scene.tomatoes]
            yield View(
                image=image,
                boxes=np.array([sight.outline.box() for sight in sights]).reshape(-1, 4),
                visible=np.array([sight.visible_fraction for sight in sights]),
                ripeness=np.array([RIPENESS_SCORE[tomato.ripeness] for tomato in scene.tomatoes]),
                whole=True,
                mask=mask,
            )


def views_of_photos(found: Iterable[Photo]) -> Iterator[View]:
    """Every photograph. A box is in pixel edges, as PASCAL VOC has it."""
    for photo in found:
        unknown = np.full(len(photo.boxes), np.nan)
        yield View(photo.image, photo.boxes - 0.5, unknown, unknown, whole=False, mask=None)

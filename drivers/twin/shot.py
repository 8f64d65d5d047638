"""What stands before the camera at a moment: all that a picture depends on but the camera's own settings."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from drivers.twin.light import Light
from drivers.twin.sightings import FruitView
from drivers.twin.solids import Capsule

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Shot:
    """``t_s`` in the clock of the process; ``base`` x, y, heading and ``row_from_camera`` (4, 4) in the row frame.

    ``bodies`` are the arm's, as they stand.
    """

    t_s: float
    base: tuple[float, float, float]
    row_from_camera: Array
    light: Light
    bodies: tuple[Capsule, ...]

    @property
    def pose(self) -> tuple[object, ...]:
        """Equal for two shots of the same scene from the same place, whatever the light."""
        solids = ((body.p0_m.tobytes(), body.p1_m.tobytes()) for body in self.bodies)
        return self.row_from_camera.tobytes(), *solids


def view_line(shot: Shot, sequence: int, seen: Iterable[FruitView]) -> dict[str, Any]:
    """The line of the truth file that tells what was to be seen in a frame."""
    fruits = [
        {
            "id": view.id,
            "visible": [view.left.visible_fraction, view.right.visible_fraction],
            "in_image": [view.left.in_image_fraction, view.right.in_image_fraction],
            "centre": view.centre_m.tolist(),
        }
        for view in seen
    ]
    return {"kind": "view", "t": shot.t_s, "sequence": sequence, "base": list(shot.base), "fruits": fruits}

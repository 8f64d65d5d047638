"""A camera that never looks: every pair is one and the same picture, told apart by its noise. For runs of days."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from drivers.twin.canvas import Picture
from drivers.twin.light import Light, light_at
from drivers.twin.optics import StereoOptics
from drivers.twin.plants import grow
from drivers.twin.renderer import DEFAULT_EXPOSURE_S, StereoRenderer
from drivers.twin.scene import Scene
from drivers.twin.sightings import FruitView
from drivers.twin.solids import Capsule

NOISY_ROWS = 8  # every eighth


class BlindRenderer:
    """Stands in for ``StereoRenderer``: real plants, painted once, whatever stands before the camera.

    ``row_from_camera`` (4, 4) is the pose of the last pair, for a detector that asks the greenhouse instead.
    """

    def __init__(self, scene: Scene, optics: StereoOptics, row_from_camera: npt.ArrayLike) -> None:
        self.row_from_camera = np.asarray(row_from_camera, dtype=np.float64)
        painter = StereoRenderer(grow(scene), optics, scene.seed)
        self._pair = painter.render(self.row_from_camera, light_at(scene.hour, scene.weather))

    def render(
        self, row_from_camera: npt.ArrayLike, light: Light, exposure_s: float = DEFAULT_EXPOSURE_S, gain: float = 1.0,
        arm: Sequence[Capsule] = (), frame: int = 0,
    ) -> tuple[Picture, Picture]:  # fmt: skip
        """As ``StereoRenderer.render``; light, exposure and arm change nothing."""
        self.row_from_camera = np.asarray(row_from_camera, dtype=np.float64)
        left, right = (picture.copy() for picture in self._pair)
        noise = np.random.default_rng(frame).integers(0, 2, (2, *left[::NOISY_ROWS].shape), dtype=np.uint8)
        left[::NOISY_ROWS] ^= noise[0]
        right[::NOISY_ROWS] ^= noise[1]
        return left, right

    def truth(self, row_from_camera: npt.ArrayLike, arm: Sequence[Capsule] = ()) -> tuple[FruitView, ...]:
        """Nobody looked."""
        return ()

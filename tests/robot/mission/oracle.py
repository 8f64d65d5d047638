"""A detector that knows: what the last exposed pair truly shows, with seeded noise. Missions without vision."""

from __future__ import annotations

import zlib
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from drivers.twin.renderer import FruitView, StereoRenderer
from drivers.twin.solids import Capsule, TwinFruit
from robot.vision.stereo_rig import StereoRig
from robot.vision.values import Circle, Fruit, Ripeness

Image = npt.NDArray[np.uint8]

SIGMA_M = np.array([0.002, 0.002, 0.008])
SIZE_SIGMA, HIDDEN_SIZE_SIGMA = 0.04, 0.12
LEAST_VISIBLE = 0.35
MEASURED_FROM = 0.6
SCORES = {Ripeness.GREEN: 0.05, Ripeness.TURNING: 0.5, Ripeness.RED: 0.95}


class WatchedRenderer(StereoRenderer):
    """Remembers what its last pair truly shows."""

    views: tuple[FruitView, ...] = ()

    def render(  # type: ignore[override, no-untyped-def]
        self, row_from_camera, light, exposure_s=0.004, gain=1.0, arm: Sequence[Capsule] = (), frame=0, **options
    ):
        pair = super().render(row_from_camera, light, exposure_s, gain, arm, frame, **options)
        self.views = self.truth(row_from_camera, arm)
        return pair


class Oracle:
    """Implements ``robot.vision.detector.Detector``: every fruit of which both eyes see ``LEAST_VISIBLE``.

    Noise is 2, 2 and 8 mm along the camera's axes and 4 % of the diameter (12 % where less than ``MEASURED_FROM`` is
    seen: too hidden to measure), drawn from the pair's own pixels and the fruit, so that the same pair gives the same
    fruit.
    """

    def __init__(self, renderer: WatchedRenderer, fruits: Sequence[TwinFruit]) -> None:
        self._renderer = renderer
        self._fruits = {fruit.id: fruit for fruit in fruits}

    def detect(self, left: Image, right: Image, rig: StereoRig) -> tuple[Fruit, ...]:
        pixels = zlib.crc32(right.tobytes(), zlib.crc32(left.tobytes()))
        return tuple(
            self._fruit(view, pixels, rig) for view in self._renderer.views if view.visible_fraction >= LEAST_VISIBLE
        )

    def detect_mono(self, image: Image) -> tuple[Circle, ...]:
        raise NotImplementedError("the oracle knows pairs only")

    def _fruit(self, view: FruitView, pixels: int, rig: StereoRig) -> Fruit:
        rng = np.random.default_rng([pixels, view.id])
        true = self._fruits[view.id]
        ripeness = Ripeness(true.ripeness)
        centre_m = view.centre_m + rng.normal(0.0, SIGMA_M)
        measured = view.visible_fraction >= MEASURED_FROM
        size_sigma = SIZE_SIGMA if measured else HIDDEN_SIZE_SIGMA
        diameter_m = true.diameter_m * (1.0 + float(rng.normal(0.0, size_sigma)))
        circles = [
            Circle(float(u), float(v), 0.5 * diameter_m * float(K[0, 0] / centre_m[2]), ripeness, 0.95)
            for K, (u, v) in (
                (rig.K_left, rig.project_left([centre_m])[0]),
                (rig.K_right, rig.project_right([centre_m])[0]),
            )
        ]
        return Fruit(
            centre_m=centre_m,
            covariance_m2=np.diag(SIGMA_M**2),
            diameter_m=diameter_m,
            diameter_sigma_m=size_sigma * diameter_m,
            ripeness=ripeness,
            ripeness_score=SCORES[ripeness],
            confidence=0.95,
            visible_fraction=view.visible_fraction,
            measured=measured,
            left=circles[0],
            right=circles[1],
        )

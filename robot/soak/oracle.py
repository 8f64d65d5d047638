"""A detector that reads the twin's truth, with noise, with fruit that it overlooks, and fruit that is not there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from drivers.twin.blind_renderer import BlindRenderer
from drivers.twin.solids import TwinFruit
from robot.vision.stereo_rig import StereoRig
from robot.vision.values import Circle, Fruit, Ripeness

Array = npt.NDArray[np.float64]
Image = npt.NDArray[np.uint8]

SCORES = {Ripeness.GREEN: 0.05, Ripeness.TURNING: 0.5, Ripeness.RED: 0.95}
NEAR_M, FAR_M = 0.3, 1.4
BORDER_PX = 8.0


@dataclass(frozen=True, slots=True)
class Errors:
    """One sigma along the camera's axes and of the diameter; shares of fruit overlooked, half hidden and made up."""

    place_m: tuple[float, float, float] = (0.002, 0.002, 0.008)
    size: float = 0.04
    hidden_size: float = 0.12
    missed: float = 0.08
    hidden: float = 0.25
    phantoms: float = 0.02


class TruthReader:
    """Implements ``robot.vision.detector.Detector``. What it says depends on the pose and the seed."""

    def __init__(self, renderer: BlindRenderer, fruits: Sequence[TwinFruit], seed: int, errors: Errors) -> None:
        self._renderer, self._fruits, self._errors = renderer, tuple(fruits), errors
        self._centres_m = np.array([fruit.centre_m for fruit in fruits]).reshape(-1, 3)
        self._rng = np.random.default_rng([seed, 0x0AC1])
        hiding = np.random.default_rng([seed, 0x41DE]).random(len(self._fruits))
        self._hidden = hiding < errors.hidden

    def detect(self, left: Image, right: Image, rig: StereoRig) -> tuple[Fruit, ...]:
        camera_from_row = np.linalg.inv(self._renderer.row_from_camera)
        centres_m = self._centres_m @ camera_from_row[:3, :3].T + camera_from_row[:3, 3]
        found = []
        for index in np.flatnonzero((centres_m[:, 2] > NEAR_M) & (centres_m[:, 2] < FAR_M)):
            if self._rng.random() >= self._errors.missed:
                found.append(self._seen(self._fruits[index], centres_m[index], bool(self._hidden[index]), rig))
        if self._rng.random() < self._errors.phantoms:
            found.append(self._phantom(rig))
        return tuple(fruit for fruit in found if fruit is not None)

    def detect_mono(self, image: Image) -> tuple[Circle, ...]:
        raise NotImplementedError("reads the truth of pairs only")

    def _phantom(self, rig: StereoRig) -> Fruit | None:
        """A leaf that looked like a fruit, somewhere before the camera."""
        depth_m = float(self._rng.uniform(0.5, 0.8))
        x, y = self._rng.uniform(-0.25, 0.25, 2) * depth_m
        return self._fruit(np.array([x, y, depth_m]), 0.06, Ripeness.GREEN, False, rig)

    def _seen(self, fruit: TwinFruit, centre_m: Array, hidden: bool, rig: StereoRig) -> Fruit | None:
        return self._fruit(centre_m, fruit.diameter_m, Ripeness(fruit.ripeness), hidden, rig)

    def _fruit(
        self, true_m: Array, true_diameter_m: float, ripeness: Ripeness, hidden: bool, rig: StereoRig
    ) -> Fruit | None:
        """None where it is not wholly in both pictures."""
        centre_m = true_m + self._rng.normal(0.0, self._errors.place_m)
        pixels = rig.project_left([centre_m])[0], rig.project_right([centre_m])[0]
        width, height = rig.image_size
        if not all(BORDER_PX < u < width - BORDER_PX and BORDER_PX < v < height - BORDER_PX for u, v in pixels):
            return None
        sigma = self._errors.hidden_size if hidden else self._errors.size
        diameter_m = true_diameter_m * max(0.3, 1.0 + float(self._rng.normal(0.0, sigma)))
        radius_px = 0.5 * diameter_m * float(rig.K_left[0, 0] / centre_m[2])
        left, right = (Circle(float(u), float(v), radius_px, ripeness, 0.95) for u, v in pixels)
        return Fruit(
            centre_m=centre_m,
            covariance_m2=np.diag(np.square(self._errors.place_m)),
            diameter_m=diameter_m,
            diameter_sigma_m=sigma * diameter_m,
            ripeness=ripeness,
            ripeness_score=SCORES[ripeness],
            confidence=0.95,
            visible_fraction=0.5 if hidden else 0.9,
            measured=not hidden,
            left=left,
            right=right,
        )

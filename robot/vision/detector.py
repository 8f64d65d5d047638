"""The seam between the robot and whatever finds fruit."""

from __future__ import annotations

from typing import Protocol

import numpy as np
import numpy.typing as npt

from robot.vision.stereo_rig import StereoRig
from robot.vision.values import Circle, Fruit

Image = npt.NDArray[np.uint8]


class Detector(Protocol):
    """Finds fruit. Pure: the same images give the same fruit, and nothing is kept from one call to the next."""

    def detect(self, left: Image, right: Image, rig: StereoRig) -> tuple[Fruit, ...]:
        """Fruit of one pair of (height, width, 3) BGR images as the cameras deliver them (not rectified).

        Raises ``ValueError`` when the images are not of the rig's size.
        """
        ...

    def detect_mono(self, image: Image) -> tuple[Circle, ...]:
        """Fruit of one (height, width, 3) BGR image of any size, without range."""
        ...

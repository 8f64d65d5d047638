"""What a stereo camera gives."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Image = npt.NDArray[np.uint8]


@dataclass(frozen=True, slots=True, eq=False)
class StereoFrame:
    """One synchronised pair.

    ``stamp_s`` is the middle of the exposure in loop time (seconds); ``sequence`` counts up by one a frame;
    ``left`` and ``right`` are (height, width, 3) BGR, 8 bit sRGB, as the sensor delivers them (not rectified).
    """

    stamp_s: float
    sequence: int
    left: Image
    right: Image
    exposure_s: float
    gain: float

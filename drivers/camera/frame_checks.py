"""What a pair of pictures tells of the camera's own faults. Pure functions, cheap enough for every frame.

Thresholds were set on pictures of the simulated row (weather, hours, gains, leaves before the lens), see
``tests/drivers/camera/test_frame_checks.py``, and stand well off both sides there.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum

import cv2
import numpy as np
import numpy.typing as npt

from drivers.camera.values import Image

Grey = npt.NDArray[np.uint8]
Floats = npt.NDArray[np.floating]

WHITE_CODE = 250
WHITE_SHARE = 0.95
NOISE_CONTRAST = 0.10, 0.115  # in codes, plus a share of the mean: read noise alone leaves less than that, at any gain
DARK_MEAN = 20.0
IDENTICAL_FRAMES = 3
SWAPPED_SHARE = 0.70  # of the matches; at most a ninth of a true pair's point the wrong way
SWAPPED_MATCHES = 8
ROW_LIMIT_PX = 1.5
YAW_LIMIT_RAD = math.radians(0.5)  # shifts every disparity by about 4 px at 640 px width
SUSPECT_ROW_PX = 1.0  # in one pair; a true rig's are 0.4 px apart at most, one turned by 1 deg 1.3 px and more
ROW_MATCHES, YAW_MATCHES, POOLED_FRAMES, LEAST_FRAMES = 60, 200, 30, 5
FLAT_CONTRAST = 2.0  # codes; a lens under a hand or tape gives less, any scene of that light more
BLURRED_SHARPNESS = 0.50
LEAST_DETAIL = 0.22  # a leaf before the lens at night leaves 0.31
SHARPNESS_RATIO = 0.75  # of the two eyes
BRIGHTNESS_RATIO = 0.55
JUDGED_CONTRAST = 6.0  # with less, noise and compression hide what is sharp


class PictureFault(StrEnum):
    """What can be wrong with pictures."""

    FROZEN = "frozen"
    BLACK = "black"
    WHITE = "white"
    COVERED = "covered"
    BLURRED = "blurred"
    UNEQUAL = "unequal"
    SWAPPED = "swapped"
    DECALIBRATED = "decalibrated"


@dataclass(frozen=True, slots=True)
class ViewMeasures:
    """One eye's picture in numbers: codes of 0 to 255 for ``mean`` and ``contrast``; the rest are ratios.

    ``contrast`` is the spread of what is larger than 8 px; ``sharpness`` how strong edges are at 4 px against those at
    8 px, ``detail`` against the contrast, both with the share of the noise taken off; ``white_share`` is of pixels that
    are white.
    """

    mean: float
    contrast: float
    sharpness: float
    detail: float
    white_share: float


def measure(grey: Grey) -> ViewMeasures:
    """Measures of one eye's picture (height, width), grey."""
    height, width = grey.shape
    quarter = cv2.resize(grey, (width // 4, height // 4), interpolation=cv2.INTER_AREA).astype(np.float32)
    eighth = cv2.resize(quarter, (width // 8, height // 8), interpolation=cv2.INTER_AREA)
    noise = float(np.median(np.abs(cv2.Laplacian(grey[::2], cv2.CV_16S, ksize=1)))) / 0.6745
    fine, coarse = (
        math.sqrt(max(float(cv2.Laplacian(small, cv2.CV_32F, ksize=1).var()) - (noise / scale) ** 2, 0.0))
        for small, scale in ((quarter, 4.0), (eighth, 8.0))
    )
    contrast = float(eighth.std())
    return ViewMeasures(
        mean=float(eighth.mean()),
        contrast=contrast,
        sharpness=fine / max(coarse, 0.1),
        detail=fine / max(contrast, 0.1),
        white_share=float(np.count_nonzero(grey >= WHITE_CODE)) / grey.size,
    )


def grey_of(image: Image) -> Grey:
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), dtype=np.uint8)


def fault_of_view(view: ViewMeasures) -> PictureFault | None:
    """What is wrong with one eye's picture by itself."""
    if view.white_share > WHITE_SHARE:
        return PictureFault.WHITE
    if view.mean < DARK_MEAN and view.contrast < NOISE_CONTRAST[0] + NOISE_CONTRAST[1] * view.mean:
        return PictureFault.BLACK
    if view.mean >= DARK_MEAN and view.contrast < FLAT_CONTRAST:
        return PictureFault.COVERED
    if view.contrast >= JUDGED_CONTRAST and (view.sharpness < BLURRED_SHARPNESS or view.detail < LEAST_DETAIL):
        return PictureFault.BLURRED
    return None


def fault_between(left: ViewMeasures, right: ViewMeasures) -> PictureFault | None:
    """What is wrong when the eyes are held against each other: one lens is dirtier than the other."""
    dim, bright = sorted((left.mean, right.mean))
    if bright >= DARK_MEAN and dim < BRIGHTNESS_RATIO * bright:
        return PictureFault.UNEQUAL
    if min(left.contrast, right.contrast) >= JUDGED_CONTRAST:
        dull, sharp = sorted((left.sharpness, right.sharpness))
        if dull < SHARPNESS_RATIO * sharp:
            return PictureFault.BLURRED
    return None

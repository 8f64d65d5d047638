"""A picture as the proposing network takes it."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Plane = npt.NDArray[np.float32]

MEAN_CODE = 0.40
LEAST_GAIN, MOST_GAIN = 0.5, 16.0


def normalised(image: npt.NDArray[np.uint8]) -> Plane:
    """(h, w, 3) of about -0.5..1: codes brought to a common mean, so that exposure and gain hardly matter."""
    code = image.astype(np.float32) * np.float32(1 / 255.0)
    gain = np.clip(MEAN_CODE / max(float(code.mean()), 1e-3), LEAST_GAIN, MOST_GAIN)
    return np.asarray(np.minimum(code * np.float32(gain), np.float32(1.5)) - np.float32(0.5), dtype=np.float32)

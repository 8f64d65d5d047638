"""Volume, section 3.3.4."""

from __future__ import annotations

import math


def sphere_volume_m3(diameter_m: float) -> float:
    """V = 4/3 pi R^3 of a fruit's sphere of equal volume."""
    return 4.0 / 3.0 * math.pi * (diameter_m / 2.0) ** 3

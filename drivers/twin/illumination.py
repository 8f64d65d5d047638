"""From light and surface to radiance, and to the codes the pictures are kept in."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from drivers.twin.light import LAMP_REFERENCE_M, Light, rgb_of_colour_temperature

Array = npt.NDArray[np.float64]

WHITE_BALANCE_K = 5600.0
CANOPY_SKY_SHARE = 0.6  # of the sky a leaf or fruit inside the row sees
BOUNCE_SHARE = 0.16  # of the light on soil and wall that comes back
_NEAREST_LAMP_M = 0.35


@dataclass(frozen=True, slots=True, eq=False)
class Illumination:
    """Light as the camera's channels see it, all (3,) BGR in W/m2 after white balance.

    ``full_scale`` is the radiance that a picture code of 255 stands for: codes are 255 * sqrt(radiance / full_scale).
    """

    sun_direction: Array
    sun: Array
    sky: Array
    bounce: Array
    lamp: Array
    full_scale: float

    @classmethod
    def of(cls, light: Light) -> Illumination:
        sun = light.sun_w_m2 * _bgr(light.sun_colour_k)
        sky = light.sky_w_m2 * _bgr(light.sky_colour_k)
        lamp = light.lamp_w_m2 * _bgr(light.lamp_colour_k)
        brightest = light.sun_w_m2 + light.sky_w_m2 + light.lamp_w_m2 * (LAMP_REFERENCE_M / _NEAREST_LAMP_M) ** 2
        return cls(
            sun_direction=light.sun_direction,
            sun=sun,
            sky=sky,
            bounce=BOUNCE_SHARE * (sun * max(float(light.sun_direction[2]), 0.1) + sky),
            lamp=lamp,
            full_scale=max(0.75 * brightest / np.pi, 1e-9),
        )

    def ambient(self, normal_up: Array) -> Array:
        """(n, 3) irradiance of sky and surroundings on planes inside the row; ``normal_up`` (n,) is the normal's z."""
        up = normal_up[:, None]
        return CANOPY_SKY_SHARE * self.sky * (0.5 + 0.5 * up) + self.bounce * (0.75 - 0.25 * up)

    def lamp_at(self, distance_m: Array) -> Array:
        """(n, 3) irradiance of the lamp on planes that face it."""
        return self.lamp * (LAMP_REFERENCE_M / np.maximum(distance_m, 0.05)[:, None]) ** 2

    def gain(self, irradiance: Array) -> Array:
        """What multiplies the code of a reflectance to give the code of its radiance (Lambert)."""
        return np.asarray(np.sqrt(np.maximum(irradiance, 0.0) / (np.pi * self.full_scale)))


def _bgr(colour_k: float) -> Array:
    return (rgb_of_colour_temperature(colour_k) / rgb_of_colour_temperature(WHITE_BALANCE_K))[::-1]

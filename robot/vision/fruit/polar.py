"""Pictures of a fruit unrolled round the outline that it should have: angle downwards, outwards to the right.

Sample positions go through the lens model of each camera; the stored pixels are not resampled beforehand.
"""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

from robot.vision.fruit.joint_fit import outline_rays
from robot.vision.fruit.rectify import ParallelPair
from robot.vision.stereo_rig import StereoRig

Array = npt.NDArray[np.float64]
Image = npt.NDArray[np.uint8]

ANGLES, STEPS = 48, 24
TURN_RAD: Array = np.arange(ANGLES, dtype=np.float64) * (2 * np.pi / ANGLES)
ALONG = np.linspace(-1.0, 1.0, STEPS)


def sample_places(
    centre_m: Array, radius_m: Array, harmonic: Array, reach: Array, rig: StereoRig, pair: ParallelPair
) -> tuple[Array, Array]:
    """Pixels (n, 2, ANGLES, STEPS, 2) of the stored images, and the half-width (n,) of the band in radians.

    ``centre_m`` (n, 3) in the pair's frame; the band reaches ``reach`` (n,) of the fruit's radius to both sides of the
    outline. Along each ray the lens is followed by a parabola through three points.
    """
    distance = np.linalg.norm(centre_m, axis=1)
    band = reach * np.arcsin(np.clip(radius_m / distance, 1e-4, 0.9))
    ends = band[:, None] * np.array([-1.0, 0.0, 1.0])
    rays = outline_rays(centre_m, radius_m, harmonic, pair.eyes_m, TURN_RAD, ends[:, None, None, :])
    places = np.empty((len(radius_m), 2, ANGLES, STEPS, 2))
    along = ALONG[:, None]
    for eye in range(2):
        pixels = _pixels(rays[:, eye], eye, rig, pair)
        first, middle, last = np.moveaxis(pixels, -2, 0)
        bend = 0.5 * (first + last) - middle
        places[:, eye] = (
            middle[..., None, :] + along * (0.5 * (last - first))[..., None, :] + along**2 * bend[..., None, :]
        )
    return places, band


def _pixels(rays: Array, eye: int, rig: StereoRig, pair: ParallelPair) -> Array:
    flat = rays.reshape(-1, 3)
    if eye == 0:
        pixels = rig.project_left(flat @ pair.rect_from_left)
    else:
        pixels = rig.project_right((flat @ pair.rect_from_right - rig.t_m) @ rig.R)
    return pixels.reshape(*rays.shape[:-1], 2)


def unrolled(images: tuple[Image, Image], places: Array) -> npt.NDArray[np.float32]:
    """(n, 8, ANGLES, STEPS) of both views at ``places``: blue, green and red of the left, of the right, and whether
    the left and the right sample lie in the picture. Codes are relative to the mean of the fruit's patch.
    """
    count = len(places)
    out = np.empty((count, 8, ANGLES, STEPS), dtype=np.float32)
    for eye, image in enumerate(images):
        height, width = image.shape[:2]
        at = places[:, eye].astype(np.float32)
        codes = _sampled(image, at)
        out[:, 3 * eye : 3 * eye + 3] = codes.transpose(0, 3, 1, 2)
        out[:, 6 + eye] = (at >= 0).all(-1) & (at[..., 0] <= width - 1) & (at[..., 1] <= height - 1)
    mean = out[:, :6].mean(axis=(1, 2, 3), keepdims=True)
    out[:, :6] = np.minimum(out[:, :6] / (mean + 1.0), 4.0) - 1.0
    return out


def _sampled(image: Image, places: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    """(n, ANGLES, STEPS, 3) bilinear samples; beyond the border the border's value."""
    if len(places) == 0:
        return np.zeros((0, ANGLES, STEPS, 3), dtype=np.float32)
    flat = places.reshape(-1, STEPS, 2)
    blocks = [
        cv2.remap(image, block[..., 0], block[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        for block in np.array_split(flat, range(16384, len(flat), 16384))
    ]
    return np.asarray(np.concatenate(blocks).reshape(*places.shape[:-1], 3), dtype=np.float32)

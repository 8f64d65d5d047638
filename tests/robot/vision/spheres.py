"""Pictures of spheres among leaves, exact outlines, for detectors to look at."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from robot.geometry import rotation_from_rpy
from robot.vision.stereo_rig import StereoRig

Image = npt.NDArray[np.uint8]

LEAF_BGR, RED_BGR = (40, 140, 50), (30, 30, 190)


@dataclass(frozen=True)
class Ball:
    centre_m: tuple[float, float, float]
    diameter_m: float
    colour_bgr: tuple[int, int, int] = RED_BGR


def small_rig(tilted: bool) -> StereoRig:
    """320x240, 60 mm; ``tilted``: distorted, unequal cameras and the right one turned by a degree or two."""
    if not tilted:
        K = np.array([[229.0, 0.0, 159.5], [0.0, 229.0, 119.5], [0.0, 0.0, 1.0]])
        return StereoRig((320, 240), K, K, np.zeros(5), np.zeros(5), np.eye(3), np.array([-0.06, 0.0, 0.0]))
    return StereoRig(
        (320, 240),
        np.array([[229.3, 0.0, 161.8], [0.0, 228.9, 118.2], [0.0, 0.0, 1.0]]),
        np.array([[233.1, 0.0, 158.0], [0.0, 232.8, 121.4], [0.0, 0.0, 1.0]]),
        np.array([-0.11, 0.026, 0.001, -0.0005, 0.0]),
        np.array([-0.104, 0.022, 0.0, 0.001, 0.0]),
        rotation_from_rpy(0.012, -0.02, 0.025),
        np.array([-0.06, 0.002, -0.001]),
    )


def photograph(balls: Sequence[Ball], rig: StereoRig) -> tuple[Image, Image]:
    """The left and right stored images; nearer balls hide farther ones."""
    width, height = rig.image_size
    v, u = np.mgrid[:height, :width]
    stored = np.column_stack([u.ravel(), v.ravel()])
    views = []
    for undistorted, K, R, t_m in (
        (rig.undistort_left(stored), rig.K_left, np.eye(3), np.zeros(3)),
        (rig.undistort_right(stored), rig.K_right, rig.R, rig.t_m),
    ):
        rays = np.column_stack([undistorted, np.ones(len(stored))]) @ np.linalg.inv(K).T
        rays /= np.linalg.norm(rays, axis=1, keepdims=True)
        image = np.tile(np.array(LEAF_BGR, dtype=np.float64), (len(stored), 1))
        for ball in sorted(balls, key=lambda ball: -ball.centre_m[2]):
            centre_m = R @ np.array(ball.centre_m) + t_m
            distance_m = float(np.linalg.norm(centre_m))
            off_axis = np.arccos(np.clip(rays @ centre_m / distance_m, -1.0, 1.0))
            edge = np.arcsin(ball.diameter_m / 2.0 / distance_m)  # a sphere's outline is its tangent cone
            cover = np.clip((edge - off_axis) * K[0, 0] + 0.5, 0.0, 1.0)[:, None]
            image = image * (1.0 - cover) + np.array(ball.colour_bgr) * cover
        views.append(np.round(image).astype(np.uint8).reshape(height, width, 3))
    return views[0], views[1]

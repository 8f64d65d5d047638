"""Pairs of pictures from the twin's greenhouse, with the truth about every fruit in them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from drivers.twin.light import light_at
from drivers.twin.optics import StereoOptics
from drivers.twin.plants import grow
from drivers.twin.renderer import StereoRenderer
from drivers.twin.scene import Scene
from robot.geometry import rotation_from_rpy
from robot.vision.stereo_rig import StereoRig

Image = npt.NDArray[np.uint8]
Array = npt.NDArray[np.float64]
K = np.array([[457.0, 0.0, 319.5], [0.0, 457.0, 239.5], [0.0, 0.0, 1.0]])


@dataclass(frozen=True)
class SeenFruit:
    centre_m: Array
    diameter_m: float
    ripeness: str
    visible_fraction: float


@dataclass(frozen=True)
class View:
    left: Image
    right: Image
    rig: StereoRig
    fruits: tuple[SeenFruit, ...]


def demo_rig() -> StereoRig:
    return StereoRig((640, 480), K, K, np.zeros(5), np.zeros(5), np.eye(3), np.array([-0.06, 0.0, 0.0]))


def crooked_rig() -> StereoRig:
    """Distorted lenses, unequal cameras, the right one turned by about a degree."""
    K_right = np.array([[455.0, 0.0, 316.1], [0.0, 454.4, 242.8], [0.0, 0.0, 1.0]])
    dist_left, dist_right = np.array([-0.11, 0.026, 0.0005, 0.0, 0.0]), np.array([-0.104, 0.022, 0.0, 0.0, 0.0])
    return StereoRig(
        (640, 480), K, K_right, dist_left, dist_right, rotation_from_rpy(0.004, -0.009, 0.012), np.array([-0.06, 0, 0])
    )


def views(rig: StereoRig, *, seed: int, hour: float, at_x_m: tuple[float, ...]) -> list[View]:
    """What the rig sees of one row from several stops."""
    greenhouse = grow(Scene(seed=seed, hour=hour, row_length_m=2.5))
    optics = StereoOptics(rig.image_size, rig.K_left, rig.K_right, rig.dist_left, rig.dist_right, rig.R, rig.t_m)
    renderer = StereoRenderer(greenhouse, optics, seed)
    by_id = {fruit.id: fruit for fruit in greenhouse.fruits}
    out = []
    for frame, x_m in enumerate(at_x_m):
        pose = np.eye(4)
        pose[:3, :3] = np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]])
        pose[:3, 3] = (x_m, 0.05, 0.88)
        left, right = renderer.render(pose, light_at(hour), frame=frame)
        fruits = tuple(
            SeenFruit(seen.centre_m, by_id[seen.id].diameter_m, by_id[seen.id].ripeness, seen.visible_fraction)
            for seen in renderer.truth(pose)
        )
        out.append(View(left, right, rig, fruits))
    return out

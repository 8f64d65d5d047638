"""Small greenhouses and rigs for the tests of the twin's scene."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from drivers.twin.optics import StereoOptics
from drivers.twin.solids import Capsule, Greenhouse, Leaves, TwinFruit

Array = npt.NDArray[np.float64]

NO_LEAVES = Leaves(
    np.zeros((0, 3)), np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0, dtype=np.int64), np.zeros((0, 3))
)


def fruit(
    centre_m: tuple[float, float, float],
    diameter_m: float = 0.07,
    oblateness: float = 0.9,
    axis: tuple[float, float, float] = (0.0, 0.0, 1.0),
    number: int = 1,
) -> TwinFruit:
    red = (0.46, 0.03, 0.02)
    unit = np.array(axis) / np.linalg.norm(axis)
    return TwinFruit(number, np.array(centre_m), diameter_m, oblateness, unit, "red", red, red)


def leaf(centre_m: tuple[float, float, float], size_m: float = 0.2, texture: int = 5) -> Leaves:
    """One leaf square to the view along y, pointing up."""
    u, v = np.array([size_m, 0.0, 0.0]), np.array([0.0, 0.0, size_m])
    corner = np.array(centre_m) - 0.5 * (u + v)
    return Leaves(corner[None], u[None], v[None], np.array([texture]), np.ones((1, 3)))


def greenhouse(
    *fruits: TwinFruit, leaves: Leaves = NO_LEAVES, stems: tuple[Capsule, ...] = (), wall_y_m: float = 1.6
) -> Greenhouse:
    return Greenhouse(fruits, leaves, stems, (), wall_y_m, 3)


def ideal_optics() -> StereoOptics:
    K = np.array([[457.0, 0.0, 319.5], [0.0, 457.0, 239.5], [0.0, 0.0, 1.0]])
    return StereoOptics((640, 480), K, K, np.zeros(5), np.zeros(5), np.eye(3), np.array([-0.06, 0.0, 0.0]))


def bent_optics() -> StereoOptics:
    """Barrel distortion, unequal cameras, the right one turned by 0.7 degrees."""
    axis = np.array([0.5, -0.76, 0.42])
    x, y, z = np.deg2rad(0.7) * axis / np.linalg.norm(axis)
    u, _, vt = np.linalg.svd(np.array([[1.0, -z, y], [z, 1.0, -x], [-y, x, 1.0]]))
    return StereoOptics(
        (640, 480),
        np.array([[458.6, 0.0, 323.7], [0.0, 457.8, 236.4], [0.0, 0.0, 1.0]]),
        np.array([[456.2, 0.0, 316.1], [0.0, 455.7, 242.8], [0.0, 0.0, 1.0]]),
        np.array([-0.11, 0.026, 0.0004, -0.0003, 0.0]),
        np.array([-0.104, 0.022, 0.0, 0.0002, 0.0]),
        u @ vt,
        np.array([-0.06, -0.0006, -0.0001]),
    )


def camera_at(x_m: float, side: float = 1.0) -> Array:
    """Row from left camera, 0.88 m up, looking square to the row at the left (side 1) or right (side -1)."""
    pose = np.eye(4)
    pose[:3, :3] = np.column_stack([[side, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, side, 0.0]])
    pose[:3, 3] = [x_m, 0.05 * side, 0.88]
    return pose

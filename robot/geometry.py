"""Rigid transforms. Frames after REP-103: base x forward, y left, z up; cameras x right, y down, z forward.

A transform is named ``target_from_source`` and maps points of the source frame into the target frame. Metres, radians.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Vector = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Transform:
    """``x_target = rotation @ x_source + translation_m``; rotation (3, 3), translation (3,)."""

    rotation: Vector
    translation_m: Vector

    def __matmul__(self, other: Transform) -> Transform:
        """``a_from_c = a_from_b @ b_from_c``."""
        return Transform(self.rotation @ other.rotation, self.rotation @ other.translation_m + self.translation_m)

    def apply(self, points_m: npt.ArrayLike) -> Vector:
        """Map one point (3,) or many (n, 3)."""
        return np.asarray(points_m, dtype=np.float64) @ self.rotation.T + self.translation_m

    def rotate(self, vectors: npt.ArrayLike) -> Vector:
        """Map one direction (3,) or many (n, 3)."""
        return np.asarray(vectors, dtype=np.float64) @ self.rotation.T

    def rotate_covariance(self, covariance: npt.ArrayLike) -> Vector:
        """Map a (3, 3) covariance."""
        return np.asarray(self.rotation @ np.asarray(covariance, dtype=np.float64) @ self.rotation.T)

    def inverse(self) -> Transform:
        return Transform(self.rotation.T, -(self.rotation.T @ self.translation_m))

    def matrix(self) -> Vector:
        """Homogeneous (4, 4)."""
        out = np.eye(4)
        out[:3, :3] = self.rotation
        out[:3, 3] = self.translation_m
        return out


def identity() -> Transform:
    return Transform(np.eye(3), np.zeros(3))


def rotation_from_rpy(roll_rad: float, pitch_rad: float, yaw_rad: float) -> Vector:
    """Fixed-axis roll, pitch, yaw (URDF's convention): Rz(yaw) Ry(pitch) Rx(roll)."""
    cr, sr = math.cos(roll_rad), math.sin(roll_rad)
    cp, sp = math.cos(pitch_rad), math.sin(pitch_rad)
    cy, sy = math.cos(yaw_rad), math.sin(yaw_rad)
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def rpy_from_rotation(rotation: Vector) -> tuple[float, float, float]:
    """The inverse of ``rotation_from_rpy``, pitch in [-pi/2, pi/2]; looking straight up or down the roll is 0."""
    pitch = math.asin(max(-1.0, min(1.0, -float(rotation[2, 0]))))
    if abs(float(rotation[2, 0])) > 1.0 - 1e-12:
        return 0.0, pitch, math.atan2(-float(rotation[0, 1]), float(rotation[1, 1]))
    roll = math.atan2(float(rotation[2, 1]), float(rotation[2, 2]))
    return roll, pitch, math.atan2(float(rotation[1, 0]), float(rotation[0, 0]))


def transform_from_xyz_rpy(xyz_m: Sequence[float], rpy_rad: Sequence[float]) -> Transform:
    """Translation after a fixed-axis roll, pitch, yaw rotation."""
    roll, pitch, yaw = rpy_rad
    return Transform(rotation_from_rpy(roll, pitch, yaw), np.asarray(xyz_m, dtype=np.float64))


def body_from_optical() -> Transform:
    """A camera's body frame (x forward, y left, z up) from its optical frame (x right, y down, z forward)."""
    return Transform(np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]), np.zeros(3))


@dataclass(frozen=True, slots=True)
class Pose2:
    """The rover on the ground: position in metres, heading in radians from the frame's x towards its y."""

    x_m: float
    y_m: float
    heading_rad: float

    def transform(self) -> Transform:
        """``row_from_base`` when the pose is the base's in the row frame."""
        return transform_from_xyz_rpy((self.x_m, self.y_m, 0.0), (0.0, 0.0, self.heading_rad))


def wrap_angle(angle_rad: float) -> float:
    """The same angle in (-pi, pi]."""
    wrapped = math.remainder(angle_rad, math.tau)
    return math.pi if wrapped == -math.pi else wrapped

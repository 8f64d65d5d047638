"""The demo machine for aiming tests: arm beside the camera, row on the left with its stems at y = 0.70 m."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from robot.aiming import AimingParameters, CameraView, Obstacles, RoverBody, Sphere, plant_support
from robot.geometry import Transform, transform_from_xyz_rpy

URDF = Path(__file__).parents[3] / "configs" / "arms" / "viperx300_nozzle.urdf"
STOW_RAD = np.array([0.0, -0.8, 1.35, 0.0, 0.7, 0.0])
READY_RAD = np.array([0.5, -0.7, 0.3, 0.0, 0.4, 0.0])
EYES_M = (np.array([-0.03, 0.05, 0.88]), np.array([0.03, 0.05, 0.88]))
STEM_Y_M = 0.70


@dataclass(frozen=True)
class Rig:
    base_from_arm: Transform
    body: Obstacles
    parameters: AimingParameters
    views: tuple[CameraView, ...]

    def arm(self, x_m: float, y_m: float, z_m: float) -> np.ndarray:
        """A point of the base frame in the arm's."""
        return self.base_from_arm.inverse().apply(np.array([x_m, y_m, z_m]))

    def row(self, stems_x_m: tuple[float, ...] = (), fruits: tuple[tuple[np.ndarray, float], ...] = ()) -> Obstacles:
        """Rover, plant supports and fruit (base-frame centre, diameter) in the arm's frame."""
        plants = Obstacles(
            supports=tuple(plant_support(x_m, STEM_Y_M) for x_m in stems_x_m),
            fruits=tuple(Sphere(np.asarray(centre), diameter_m / 2) for centre, diameter_m in fruits),
        )
        return self.body.joined(plants.moved(self.base_from_arm.inverse()))


def demo_rig() -> Rig:
    base_from_arm = transform_from_xyz_rpy((0.15, 0.10, 0.45), (0.0, 0.0, math.pi / 2))
    arm_from_base = base_from_arm.inverse()
    looking_left = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
    K = np.array([[457.0, 0.0, 319.5], [0.0, 457.0, 239.5], [0.0, 0.0, 1.0]])
    views = tuple(CameraView(arm_from_base @ Transform(looking_left, eye_m), (640, 480), K) for eye_m in EYES_M)
    x_m, y_m, z_m = (float(value) for value in arm_from_base.apply(EYES_M[0]))
    parameters = AimingParameters(math.radians(15.0), (x_m, y_m, z_m), tuple(READY_RAD.tolist()))
    return Rig(base_from_arm, RoverBody().obstacles(base_from_arm), parameters, views)

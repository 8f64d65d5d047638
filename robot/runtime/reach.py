"""Which fruits of a simulated row the arm can reach at all: the yardstick of a run's score."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from robot.aiming import AimPlan, Obstacles, plan, plant_support
from robot.config import Config
from robot.geometry import Pose2, Vector
from robot.mission import MissionSettings
from robot.runtime.settings import load_arm, load_row, mission_settings

FARTHEST_STOP_M = 0.7


def reachable_fruits(config: Config, config_path: Path, fruits: Mapping[int, tuple[Vector, float]]) -> frozenset[int]:
    """The ids of those fruits, (centre in the row frame, diameter) each, that some stop of the row can aim at.

    Judged with the true centre and size, rover and supports as obstacles, from the stowed arm.
    """
    arm, _ = load_arm(config, config_path)
    settings = mission_settings(config, load_row(config, config_path), arm)
    return frozenset(number for number, (centre_m, size_m) in fruits.items() if _reach(settings, centre_m, size_m))


def _reach(settings: MissionSettings, centre_m: Vector, diameter_m: float) -> bool:
    stops = sorted(settings.row.stops, key=lambda stop: abs(stop.x_m - float(centre_m[0])))
    for stop in stops:
        if abs(stop.x_m - float(centre_m[0])) > FARTHEST_STOP_M:
            return False
        arm_from_row = (Pose2(stop.x_m, 0.0, 0.0).transform() @ settings.base_from_arm).inverse()
        plants = Obstacles(supports=tuple(plant_support(x_m, y_m) for x_m, y_m in settings.supports_m))
        around = settings.rover_body.joined(plants.moved(arm_from_row))
        stowed = np.array(settings.stow_rad)
        aimed = plan(arm_from_row.apply(centre_m), diameter_m, stowed, settings.arm_model, settings.aiming, around)
        if isinstance(aimed, AimPlan):
            return True
    return False

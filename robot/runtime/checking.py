"""Loads all that a run would load, one thing after another, and keeps going past what is wrong."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import AsyncExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from robot.aiming import ArmModel
from robot.config import Config
from robot.errors import SprayerError
from robot.navigation import Row
from robot.runtime.backends import BuildOptions, build_devices, needs_twin
from robot.runtime.devices import make_twin
from robot.runtime.settings import hand_settings, limits, load_arm, load_camera, load_row, mission_settings
from robot.vision.make import make_detector
from robot.vision.stereo_rig import StereoRig

T = TypeVar("T")


@dataclass(frozen=True, slots=True, eq=False)
class Loaded:
    """What the configuration's files hold; None for one that cannot be loaded."""

    arm: ArmModel | None
    rig: StereoRig | None
    row: Row | None


def check_loadable(config: Config, path: Path) -> tuple[Loaded, tuple[str, ...]]:
    """What could be loaded, and a line for each thing that could not. Builds every device, opens none."""
    problems: list[str] = []

    def attempt(load: Callable[[], T]) -> T | None:
        try:
            return load()
        except (SprayerError, ValueError) as error:
            problems.append(str(error))
            return None

    arm = attempt(lambda: load_arm(config, path))
    rig = attempt(lambda: load_camera(config, path))
    row = attempt(lambda: load_row(config, path))
    attempt(lambda: (limits(config), hand_settings(config)))
    attempt(lambda: make_detector(config.vision.detector))
    if arm is not None and row is not None:
        attempt(lambda: mission_settings(config, row, arm[0]))
        if rig is not None:
            attempt(lambda: _build(config, path, arm, rig, row))
    return Loaded(arm[0] if arm is not None else None, rig, row), tuple(dict.fromkeys(problems))


def _build(config: Config, path: Path, arm: tuple[ArmModel, str], rig: StereoRig, row: Row) -> None:
    model, urdf_text = arm
    twin = make_twin(config, row, rig, urdf_text, None) if needs_twin(config) else None
    build_devices(config, model, twin, time.monotonic, BuildOptions(path), AsyncExitStack())

"""What every example of a machine is made of and none changes: read and grown once."""

from __future__ import annotations

from functools import cache

import numpy as np

from drivers.twin.machine import Twin
from drivers.twin.nominal import Nominal
from drivers.twin.plants import Greenhouse, grow
from drivers.twin.scene import Scene
from robot.aiming import ArmModel
from robot.config import Config, load_config
from robot.mission.settings import DoseSettings
from robot.navigation import Row
from robot.package_files import packaged
from robot.runtime.devices import nominal_machine
from robot.runtime.settings import dose_settings, load_arm, load_camera, load_row

DEMO = packaged("configs") / "demo.toml"


class Dark:
    """A camera in which nothing can be seen; what matters is when it was asked."""

    def render(self, row_from_camera, light, exposure_s=0.004, gain=1.0, arm=(), frame=0):
        return np.zeros((2, 2, 3), np.uint8), np.zeros((2, 2, 3), np.uint8)

    def truth(self, row_from_camera, arm=()):
        return ()


class Parts:
    """What is the same in every example and never changes."""

    def __init__(self) -> None:
        self.config: Config = load_config(DEMO)
        self.row: Row = load_row(self.config, DEMO)
        model, urdf = load_arm(self.config, DEMO)
        self.arm: ArmModel = model
        self.nominal: Nominal = nominal_machine(self.config, load_camera(self.config, DEMO), urdf)
        self.scene = Scene(seed=1, row_length_m=1.0, fruits_per_plant=0.0, leaf_density=0.0)
        self.greenhouse: Greenhouse = grow(self.scene)
        self.dose: DoseSettings = dose_settings(self.config)

    def twin(self, seed: int) -> Twin:
        twin = Twin(self.nominal, self.scene, seed)
        twin.greenhouse = self.greenhouse
        twin.renderer = Dark()
        return twin


@cache
def parts() -> Parts:
    return Parts()

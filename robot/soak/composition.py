"""The mock rover of a soak: the demo's machine before rows of its own, with a camera that never looks."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from drivers.twin.blind_renderer import BlindRenderer
from drivers.twin.machine import Twin
from drivers.twin.scene import Scene
from robot.config import MAX_SEED, Config
from robot.package_files import packaged
from robot.runtime.devices import nominal_machine
from robot.runtime.settings import limits, load_arm, load_camera, load_row, mounts
from robot.soak.values import Rules

SPACING_M, FIRST_STOP_M = 0.45, 0.3
CHANGES: dict[str, dict[str, object]] = {
    "robot": {"name": "soak-rover"},
    "camera": {"exposure": "fixed"},  # the pictures do not answer to it
    "task": {"operator": "soak", "product": "water (soak)"},
}


def config_path() -> Path:
    """The configuration that a soak starts from."""
    return packaged("configs") / "demo.toml"


@dataclass(frozen=True, slots=True, eq=False)
class RowOfPlants:
    """One row to treat: its configuration, and the machine that stands before it."""

    number: int
    config: Config
    twin: Twin
    renderer: BlindRenderer


class RowGrower:
    """Grows one row after another. ``folder`` holds their routes; ``seed`` and the row's number decide everything."""

    def __init__(self, folder: Path, seed: int) -> None:
        self._folder, self._seed = folder, seed
        self._raw = tomllib.loads(config_path().read_text(encoding="utf-8"))
        for section, values in CHANGES.items():
            self._raw[section].update(values)
        self._renderer: BlindRenderer | None = None
        self.number = 0

    def next(self) -> RowOfPlants:
        self.number += 1
        rng = np.random.default_rng([self._seed, 0x50A, self.number])
        config = self._config(rng)
        row = load_row(config, config_path())
        _, urdf = load_arm(config, config_path())
        nominal = nominal_machine(config, load_camera(config, config_path()), urdf)
        scene = Scene(
            seed=config.twin.seed, hour=config.twin.hour, row_length_m=row.length_m, side=row.side,
            plant_spacing_m=config.plants.spacing_m, stem_distance_m=config.plants.stem_distance_m,
            fruits_per_plant=config.twin.fruits_per_plant,
        )  # fmt: skip
        twin = Twin(nominal, scene, config.twin.seed)
        if self._renderer is None:
            base_from_camera, _ = mounts(config)
            self._renderer = BlindRenderer(replace(scene, row_length_m=1.0), nominal.optics, base_from_camera.matrix())
        twin.renderer = self._renderer
        return RowOfPlants(self.number, config, twin, self._renderer)

    def _config(self, rng: np.random.Generator) -> Config:
        length_m = round(float(rng.uniform(6.0, 14.0)), 2)
        stops_m = [round(x, 3) for x in np.arange(FIRST_STOP_M, length_m - FIRST_STOP_M, SPACING_M).tolist()]
        route = self._folder / "route.toml"
        route.write_text(
            f'name = "soak"\n[[row]]\nname = "{self.number}"\nside = "left"\nlength_m = {length_m}\n'
            f"stops_m = {stops_m}\n",
            encoding="utf-8",
        )
        raw: dict[str, Any] = {name: dict(section) for name, section in self._raw.items()}
        raw["twin"] |= {"seed": int(rng.integers(MAX_SEED)), "fruits_per_plant": round(float(rng.uniform(2.0, 6.0)), 2)}
        raw["navigation"] |= {"route": str(route.resolve())}
        return Config(**raw)


def rules_of(config: Config) -> Rules:
    """What the monitors hold the machine to."""
    caps = limits(config)
    fluid, wheels = config.fluid, config.wheels
    return Rules(
        max_pulse_s=caps.max_pulse_s,
        max_shot_ml=caps.max_shot_ml,
        max_target_ml=caps.max_target_ml,
        max_minute_ml=caps.max_minute_ml,
        max_task_ml=caps.max_task_ml,
        pump_lease_s=fluid.pump_lease_s,
        drive_timeout_s=wheels.command_timeout_s,
        drive_braking_s=wheels.max_speed_m_s / wheels.max_acceleration_m_s2,
        valve_open_s=fluid.valve_open_s,
        valve_close_s=2.0 * fluid.valve_close_s,
        full_flow_ml_s=1.3 * fluid.nozzle_flow_ml_s,
    )

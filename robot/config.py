"""Typed, strict configuration: TOML in, frozen models out, every wrong value named with its path and a remedy.

Environment variables override single values: ``SPRAYER_DOSING__MAX_ML=7``.
"""

from __future__ import annotations

import difflib
import hashlib
import os
import tomllib
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator
from pydantic_settings import BaseSettings, PydanticBaseSettingsSource, SettingsConfigDict, SettingsError

from robot.errors import ConfigError
from robot.package_files import config_file

MAX_SEED = 2**63 - 1
_ENVIRONMENT = "SPRAYER_"

Metres = Annotated[float, Field(allow_inf_nan=False, ge=-5.0, le=5.0)]
Radians = Annotated[float, Field(allow_inf_nan=False, ge=-6.3, le=6.3)]
Vector3 = tuple[Metres, Metres, Metres]
Rotation3 = tuple[Radians, Radians, Radians]
Pixels = Annotated[int, Field(ge=64, le=8192)]
Fraction = Annotated[float, Field(allow_inf_nan=False, ge=0.0, le=1.0)]


def _between(low: float, high: float) -> Any:
    return Field(allow_inf_nan=False, ge=low, le=high)


class _Section(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class RobotSection(_Section):
    name: str = Field(min_length=1, max_length=64)
    run_directory: Path = Path("out")


class RigSection(_Section):
    """Where camera and arm are mounted on the base, described for a rig that faces left (base +y)."""

    side: Literal["left", "right"]
    camera_xyz_m: Vector3
    camera_rpy_rad: Rotation3
    arm_xyz_m: Vector3
    arm_rpy_rad: Rotation3


class CameraSection(_Section):
    backend: Literal["mock"]
    calibration: str
    image_size_px: tuple[Pixels, Pixels] = (640, 480)
    exposure_s: Annotated[float, _between(1e-5, 0.2)]
    gain: Annotated[float, _between(1.0, 32.0)] = 1.0
    lamp: Literal["off", "on"] = "off"


class ArmSection(_Section):
    backend: Literal["mock"]
    urdf: str
    stow_rad: tuple[Radians, ...]
    ready_rad: tuple[Radians, ...]
    max_velocity_rad_s: Annotated[float, _between(0.05, 5.0)]
    max_acceleration_rad_s2: Annotated[float, _between(0.1, 40.0)]
    settle_tolerance_rad: Annotated[float, _between(0.001, 0.1)] = 0.012
    settle_s: Annotated[float, _between(0.02, 1.0)] = 0.1
    settle_timeout_s: Annotated[float, _between(0.1, 10.0)] = 2.0


class RelayChannels(_Section):
    valve: Annotated[int, Field(ge=0, le=31)]
    pump: Annotated[int, Field(ge=0, le=31)]
    lamp: Annotated[int, Field(ge=0, le=31)]
    contactor: Annotated[int, Field(ge=0, le=31)]
    beacon: Annotated[int, Field(ge=0, le=31)]

    @model_validator(mode="after")
    def _each_its_own(self) -> Self:
        numbers = list(self.model_dump().values())
        if len(set(numbers)) != len(numbers):
            raise ValueError("two channels share one relay number; give each its own")
        return self


class RelaySection(_Section):
    backend: Literal["mock"]
    channels: RelayChannels
    pulse_quantum_s: Annotated[float, _between(0.001, 1.0)]
    pulse_max_s: Annotated[float, _between(0.1, 6553.5)]


class InputsSection(_Section):
    backend: Literal["mock"]


class GpsSection(_Section):
    backend: Literal["mock"]


class ModemSection(_Section):
    backend: Literal["mock"]


class WheelsSection(_Section):
    backend: Literal["mock"]
    radius_m: Annotated[float, _between(0.03, 1.0)]
    track_m: Annotated[float, _between(0.1, 3.0)]
    max_speed_m_s: Annotated[float, _between(0.01, 1.0)]
    max_acceleration_m_s2: Annotated[float, _between(0.05, 2.0)]


class TwinSection(_Section):
    """The simulated greenhouse behind mock and emulated back ends."""

    seed: Annotated[int, Field(ge=0, le=MAX_SEED)] = 1
    hour: Annotated[float, _between(8.0, 20.0)] = 12.0
    weather: Literal["clear", "overcast"] = "clear"
    gps: Literal["none", "single", "dgps", "rtk_float", "rtk_fixed"] = "rtk_fixed"
    fruits_per_plant: Annotated[float, _between(0.0, 12.0)] = 5.0


class PlantsSection(_Section):
    """The planting, as the grower knows it: where strings or canes stand that the arm must not touch."""

    stem_distance_m: Annotated[float, _between(0.5, 1.2)]
    spacing_m: Annotated[float, _between(0.2, 2.0)]


class VisionSection(_Section):
    detector: Literal["paper", "fruit"]
    duration_s: Annotated[float, _between(0.01, 10.0)] = 0.25


class TargetsSection(_Section):
    """Which fruits are treated, and when two sightings are one fruit."""

    ripeness: tuple[Literal["red", "turning", "green"], ...] = ("red", "turning", "green")
    min_confidence: Fraction = 0.7
    sure_confidence: Fraction = 0.95
    min_visible: Fraction = 0.4
    min_diameter_m: Annotated[float, _between(0.01, 0.3)] = 0.035
    max_diameter_m: Annotated[float, _between(0.01, 0.3)] = 0.17

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.min_diameter_m >= self.max_diameter_m:
            raise ValueError("min_diameter_m must be below max_diameter_m")
        return self


class AimingSection(_Section):
    cone_fill: Annotated[float, _between(0.3, 2.0)] = 0.8
    min_gap_m: Annotated[float, _between(0.02, 0.5)] = 0.06
    collision_margin_m: Annotated[float, _between(0.0, 0.1)] = 0.015


class FluidSection(_Section):
    """Nozzle, valve, pump and tank."""

    nozzle_flow_ml_s: Annotated[float, _between(0.5, 200.0)]
    nozzle_pressure_bar: Annotated[float, _between(0.5, 20.0)]
    cone_half_angle_rad: Annotated[float, _between(0.03, 1.0)]
    valve_open_s: Annotated[float, _between(0.0, 0.5)]
    valve_close_s: Annotated[float, _between(0.0, 0.5)]
    pump_pressure_bar: Annotated[float, _between(0.5, 20.0)]
    pressure_ready_fraction: Annotated[float, _between(0.3, 1.0)] = 0.9
    pressure_timeout_s: Annotated[float, _between(0.5, 60.0)] = 15.0
    pump_lease_s: Annotated[float, _between(1.0, 25.0)] = 10.0
    meter_ml_per_pulse: Annotated[float, _between(0.01, 10.0)]
    meter_tolerance: Annotated[float, _between(0.0, 0.2)] = 0.02
    tank_ml: Annotated[float, _between(100.0, 500_000.0)]
    tank_reserve_ml: Annotated[float, _between(0.0, 50_000.0)] = 200.0


class DosingSection(_Section):
    """``coefficient`` is ml per cm3 of fruit (law volume), ml per cm2 of its surface (area) or ml (fixed)."""

    law: Literal["volume", "area", "fixed"]
    coefficient: Annotated[float, _between(1e-4, 100.0)]
    min_ml: Annotated[float, _between(0.1, 50.0)]
    max_ml: Annotated[float, _between(0.1, 50.0)]
    min_pulse_s: Annotated[float, _between(0.02, 1.0)] = 0.08
    max_pulse_s: Annotated[float, _between(0.1, 5.0)] = 2.0

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.min_ml > self.max_ml:
            raise ValueError("min_ml must not exceed max_ml")
        if self.min_pulse_s >= self.max_pulse_s:
            raise ValueError("min_pulse_s must be below max_pulse_s")
        return self


class SafetySection(_Section):
    """Caps below the hard envelope of ``robot.safety.limits``, which no configuration can widen."""

    max_shot_ml: Annotated[float, _between(0.1, 50.0)]
    max_target_ml: Annotated[float, _between(0.1, 100.0)]
    max_minute_ml: Annotated[float, _between(1.0, 1000.0)]
    max_base_speed_m_s: Annotated[float, _between(0.01, 1.0)]


class TaskSection(_Section):
    product: str = Field(min_length=1, max_length=80)
    registration_number: str = Field(max_length=40)
    dilution_percent: Annotated[float, _between(0.0, 100.0)]
    operator: str = Field(min_length=1, max_length=80)
    label_cap_ml: Annotated[float, _between(1.0, 500_000.0)]
    tank_fill_ml: Annotated[float, _between(1.0, 500_000.0)]
    water: bool


class NavigationSection(_Section):
    route: str
    row: str | None = None
    landmarks: bool = True
    ahead_m: Annotated[float, _between(0.0, 2.0)] = 0.6
    cruise_speed_m_s: Annotated[float, _between(0.01, 1.0)] = 0.25
    datum_latitude_deg: Annotated[float, _between(-90.0, 90.0)] | None = None
    datum_longitude_deg: Annotated[float, _between(-180.0, 180.0)] | None = None
    datum_heading_rad: Radians = 0.0

    @model_validator(mode="after")
    def _datum_whole(self) -> Self:
        if (self.datum_latitude_deg is None) != (self.datum_longitude_deg is None):
            raise ValueError("give datum_latitude_deg and datum_longitude_deg together, or neither")
        return self


class Config(BaseSettings):
    """The whole configuration of one robot."""

    model_config = SettingsConfigDict(extra="forbid", frozen=True, env_prefix=_ENVIRONMENT, env_nested_delimiter="__")

    robot: RobotSection
    rig: RigSection
    camera: CameraSection
    arm: ArmSection
    relay: RelaySection
    inputs: InputsSection
    gps: GpsSection
    modem: ModemSection
    wheels: WheelsSection
    plants: PlantsSection
    twin: TwinSection = TwinSection()
    vision: VisionSection
    targets: TargetsSection = TargetsSection()
    aiming: AimingSection = AimingSection()
    fluid: FluidSection
    dosing: DosingSection
    safety: SafetySection
    task: TaskSection
    navigation: NavigationSection

    @classmethod
    def settings_customise_sources(
        cls,
        settings_cls: type[BaseSettings],
        init_settings: PydanticBaseSettingsSource,
        env_settings: PydanticBaseSettingsSource,
        dotenv_settings: PydanticBaseSettingsSource,
        file_secret_settings: PydanticBaseSettingsSource,
    ) -> tuple[PydanticBaseSettingsSource, ...]:
        return env_settings, init_settings

    @model_validator(mode="after")
    def _sections_agree(self) -> Self:
        if self.dosing.max_ml > self.safety.max_shot_ml:
            raise ValueError(
                f"dosing.max_ml ({self.dosing.max_ml}) exceeds safety.max_shot_ml ({self.safety.max_shot_ml})"
            )
        if self.dosing.max_pulse_s > self.relay.pulse_max_s:
            raise ValueError(
                f"dosing.max_pulse_s ({self.dosing.max_pulse_s}) exceeds relay.pulse_max_s ({self.relay.pulse_max_s}), "
                "the longest pulse that the board can time"
            )
        if self.navigation.cruise_speed_m_s > min(self.wheels.max_speed_m_s, self.safety.max_base_speed_m_s):
            raise ValueError("navigation.cruise_speed_m_s exceeds wheels.max_speed_m_s or safety.max_base_speed_m_s")
        if self.task.tank_fill_ml > self.fluid.tank_ml:
            raise ValueError(
                f"task.tank_fill_ml ({self.task.tank_fill_ml}) exceeds fluid.tank_ml ({self.fluid.tank_ml})"
            )
        if len(self.arm.stow_rad) != len(self.arm.ready_rad):
            raise ValueError("arm.stow_rad and arm.ready_rad must name the same number of joints")
        return self

    @property
    def simulated(self) -> bool:
        """Whether every back end is mock or emulated, so that nothing real can move."""
        devices = (self.camera, self.arm, self.relay, self.inputs, self.gps, self.modem, self.wheels)
        return all(device.backend in ("mock", "emulator") for device in devices)

    def content_hash(self) -> str:
        """First 16 hex digits of the SHA-256 of all values: the same configuration, the same hash."""
        return hashlib.sha256(self.model_dump_json().encode()).hexdigest()[:16]


def load_config(path: Path) -> Config:
    """Read, check and freeze a configuration file; ``ConfigError`` names file, key, what was found and the remedy."""
    found = config_file(path)
    try:
        with found.open("rb") as stream:
            raw = tomllib.load(stream)
    except OSError as error:
        raise ConfigError(f"{found}: cannot be read ({error.strerror}); check the path and its permissions") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ConfigError(f"{found}: not valid TOML ({error}); mend that line") from error
    _check_environment()
    try:
        return Config(**raw)
    except ValidationError as error:
        raise ConfigError(f"{found}: " + "; ".join(_explain(item) for item in error.errors())) from error
    except SettingsError as error:
        raise ConfigError(f"environment: {error}; set single values, like {_ENVIRONMENT}TWIN__HOUR=19") from error


def _check_environment() -> None:
    """A section that is misspelt in a variable's name would be passed over in silence: refuse it."""
    for name in os.environ:
        section, separator, _ = name.upper().removeprefix(_ENVIRONMENT).lower().partition("__")
        if name.upper().startswith(_ENVIRONMENT) and separator and section not in Config.model_fields:
            near = difflib.get_close_matches(section, Config.model_fields, n=1)
            hint = f"did you mean '{near[0]}'?" if near else f"sections are: {', '.join(Config.model_fields)}"
            raise ConfigError(f"environment variable {name}: no section '{section}'; {hint}")


def _explain(item: Any) -> str:
    path = ".".join(str(part) for part in item["loc"]) or "configuration"
    if item["type"] == "extra_forbidden":
        known = _keys_at(item["loc"][:-1])
        near = difflib.get_close_matches(str(item["loc"][-1]), known, n=1)
        hint = f"did you mean '{near[0]}'?" if near else f"known keys here: {', '.join(sorted(known))}"
        return f"unknown key '{path}'; {hint}"
    if item["type"] == "missing":
        return f"'{path}' is missing; add it"
    message = str(item["msg"]).removeprefix("Value error, ")
    found = "" if isinstance(item["input"], dict) else f", found {item['input']!r}"
    return f"'{path}': {message}{found}"


def _keys_at(location: tuple[Any, ...]) -> list[str]:
    model: Any = Config
    for part in location:
        field = model.model_fields.get(part) if hasattr(model, "model_fields") else None
        model = field.annotation if field is not None else None
    return list(model.model_fields) if hasattr(model, "model_fields") else []

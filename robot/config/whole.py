"""The whole configuration of one robot, and what its sections must agree on."""

from __future__ import annotations

import hashlib
import math
from typing import Self

from pydantic import model_validator
from pydantic_settings import BaseSettings, PydanticBaseSettingsSource, SettingsConfigDict

from robot.config.devices import (
    ArmSection,
    CameraSection,
    GpsSection,
    InputsSection,
    MockRelaySection,
    ModemSection,
    RelaySection,
    WheelsSection,
)
from robot.config.rooms import (
    AimingSection,
    DosingSection,
    FluidSection,
    NavigationSection,
    PlantsSection,
    RigSection,
    RobotSection,
    SafetySection,
    TargetsSection,
    TaskSection,
    TwinSection,
    VisionSection,
)

ENVIRONMENT = "SPRAYER_"


class Config(BaseSettings):
    """The whole configuration of one robot."""

    model_config = SettingsConfigDict(extra="forbid", frozen=True, env_prefix=ENVIRONMENT, env_nested_delimiter="__")

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
        self._treatment_agrees()
        if isinstance(self.relay, MockRelaySection) and self.dosing.max_pulse_s > self.relay.pulse_max_s:
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
        if self.camera.lamp != "off" and self.relay.channels.lamp is None:
            raise ValueError(
                f"camera.lamp is \"{self.camera.lamp}\", and relay.channels names no lamp; wire it, or set it \"off\""
            )
        if len(self.arm.stow_rad) != len(self.arm.ready_rad):
            raise ValueError("arm.stow_rad and arm.ready_rad must name the same number of joints")
        return self

    def _treatment_agrees(self) -> None:
        for ripeness in self.targets.ripeness:
            if getattr(self.dosing.factor, ripeness) == 0.0:
                raise ValueError(
                    f"dosing.factor.{ripeness} is 0, but targets.ripeness lists {ripeness} fruit as treated; "
                    f"take '{ripeness}' out of targets.ripeness, or give it a factor"
                )
        fluid, dosing = self.fluid, self.dosing
        flow_ml_s = fluid.nozzle_flow_ml_s * math.sqrt(fluid.pump_pressure_bar / fluid.nozzle_pressure_bar)
        shortest_ml = flow_ml_s * max(0.0, dosing.min_pulse_s - fluid.valve_open_s + fluid.valve_close_s)
        if dosing.hidden == "minimum" and dosing.min_ml < shortest_ml:
            raise ValueError(
                f"dosing.hidden is 'minimum', but dosing.min_ml ({dosing.min_ml:g}) is less than the shortest pulse "
                f"gives ({shortest_ml:.2f} ml in dosing.min_pulse_s); raise min_ml, or shorten the pulse"
            )

    @property
    def simulated(self) -> bool:
        """Whether every back end is a mock: the whole machine lives in this process, in virtual time."""
        devices = (self.camera, self.arm, self.relay, self.inputs, self.gps, self.modem, self.wheels)
        return all(device.backend == "mock" for device in devices)

    @property
    def emulated(self) -> bool:
        """Whether the production back ends are meant for emulators of the simulated machine."""
        return self.twin.behind == "emulators"

    def content_hash(self) -> str:
        """First 16 hex digits of the SHA-256 of all values: the same configuration, the same hash."""
        return hashlib.sha256(self.model_dump_json().encode()).hexdigest()[:16]

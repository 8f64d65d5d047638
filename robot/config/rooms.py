"""The sections of the robot itself: mission, liquid, vision, safety. Devices have sections of their own."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from robot.config.base import MAX_SEED, Fraction, Radians, Rotation3, Section, Vector3, between


class RobotSection(Section):
    name: str = Field(min_length=1, max_length=64)
    run_directory: Path = Path("out")


class RigSection(Section):
    """Where camera and arm are mounted on the base, described for a rig that faces left (base +y)."""

    side: Literal["left", "right"]
    camera_xyz_m: Vector3
    camera_rpy_rad: Rotation3
    arm_xyz_m: Vector3
    arm_rpy_rad: Rotation3


class TwinSection(Section):
    """The simulated greenhouse behind the mocks, or behind emulators that production back ends speak with."""

    behind: Literal["mocks", "emulators"] = "mocks"
    seed: Annotated[int, Field(ge=0, le=MAX_SEED)] = 1
    hour: Annotated[float, between(8.0, 20.0)] = 12.0
    weather: Literal["clear", "overcast"] = "clear"
    gps: Literal["none", "single", "dgps", "rtk_float", "rtk_fixed"] = "rtk_fixed"
    fruits_per_plant: Annotated[float, between(0.0, 12.0)] = 5.0


class PlantsSection(Section):
    """The planting, as the grower knows it: where strings or canes stand that the arm must not touch."""

    stem_distance_m: Annotated[float, between(0.5, 1.2)]
    spacing_m: Annotated[float, between(0.2, 2.0)]


class VisionSection(Section):
    detector: Literal["paper", "fruit"]
    duration_s: Annotated[float, between(0.01, 10.0)] = 0.25


class TargetsSection(Section):
    """Which fruits are treated.

    From the ripeness scores ``turning_from`` and ``red_from`` (0 green .. 1 red) a fruit counts as turning, as red.
    """

    ripeness: tuple[Literal["red", "turning", "green"], ...] = ("red", "turning", "green")
    turning_from: Annotated[float, between(0.1, 0.9)] = 0.25
    red_from: Annotated[float, between(0.1, 0.9)] = 0.75
    min_confidence: Fraction = 0.7
    sure_confidence: Fraction = 0.95
    min_visible: Fraction = 0.25
    min_diameter_m: Annotated[float, between(0.01, 0.3)] = 0.035
    max_diameter_m: Annotated[float, between(0.01, 0.3)] = 0.17

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.min_diameter_m >= self.max_diameter_m:
            raise ValueError("min_diameter_m must be below max_diameter_m")
        if not self.ripeness:
            raise ValueError("ripeness is empty: nothing would be treated; list red, turning, green or some of them")
        if self.red_from - self.turning_from < 0.2:
            raise ValueError("red_from must be 0.2 or more above turning_from")
        return self


class AimingSection(Section):
    cone_fill: Annotated[float, between(0.3, 2.0)] = 0.8
    min_gap_m: Annotated[float, between(0.02, 0.5)] = 0.06
    collision_margin_m: Annotated[float, between(0.0, 0.1)] = 0.015


class FluidSection(Section):
    """Nozzle, valve, pump and tank."""

    nozzle_flow_ml_s: Annotated[float, between(0.5, 200.0)]
    nozzle_pressure_bar: Annotated[float, between(0.5, 20.0)]
    cone_half_angle_rad: Annotated[float, between(0.03, 1.0)]
    valve_open_s: Annotated[float, between(0.0, 0.5)]
    valve_close_s: Annotated[float, between(0.0, 0.5)]
    pump_pressure_bar: Annotated[float, between(0.5, 20.0)]
    pressure_ready_fraction: Annotated[float, between(0.3, 1.0)] = 0.9
    pressure_timeout_s: Annotated[float, between(0.5, 60.0)] = 15.0
    pump_lease_s: Annotated[float, between(1.0, 25.0)] = 10.0
    meter_ml_per_pulse: Annotated[float, between(0.01, 10.0)]
    meter_tolerance: Annotated[float, between(0.0, 0.2)] = 0.02
    tank_ml: Annotated[float, between(100.0, 500_000.0)]
    tank_reserve_ml: Annotated[float, between(0.0, 50_000.0)] = 200.0


class FactorSection(Section):
    """What the dose of a fruit of this ripeness is multiplied by: 0.5 is half, 1 in full."""

    red: Annotated[float, between(0.0, 2.0)] = 1.0
    turning: Annotated[float, between(0.0, 2.0)] = 1.0
    green: Annotated[float, between(0.0, 2.0)] = 1.0


class DosingSection(Section):
    """``coefficient`` is ml per cm3 of fruit (law volume), ml per cm2 of its surface (area) or ml (fixed).

    ``hidden``: what a fruit gets of which too little is seen to measure it. "skip" nothing, "minimum" ``min_ml``,
    "estimate" the dose of its estimated diameter less one sigma.
    """

    law: Literal["volume", "area", "fixed"]
    coefficient: Annotated[float, between(1e-4, 100.0)]
    min_ml: Annotated[float, between(0.1, 50.0)]
    max_ml: Annotated[float, between(0.1, 50.0)]
    min_pulse_s: Annotated[float, between(0.02, 1.0)] = 0.08
    max_pulse_s: Annotated[float, between(0.1, 5.0)] = 2.0
    factor: FactorSection = FactorSection()
    hidden: Literal["skip", "minimum", "estimate"] = "minimum"

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.min_ml > self.max_ml:
            raise ValueError("min_ml must not exceed max_ml")
        if self.min_pulse_s >= self.max_pulse_s:
            raise ValueError("min_pulse_s must be below max_pulse_s")
        return self


class SafetySection(Section):
    """Caps below the hard envelope of ``robot.safety.limits``, which no configuration can widen.

    Below ``battery_low_v`` the machine pauses, below ``battery_stop_v`` it stops; 0 watches nothing. ``self_resume``: a
    pause ends by itself when its cause is gone and the base stands where it stood; ``longest_pause_s``: then it becomes
    a stop.
    """

    max_shot_ml: Annotated[float, between(0.1, 50.0)]
    max_target_ml: Annotated[float, between(0.1, 100.0)]
    max_square_metre_ml: Annotated[float, between(0.1, 2000.0)] = 500.0
    max_minute_ml: Annotated[float, between(1.0, 1000.0)]
    max_day_ml: Annotated[float, between(1.0, 1_000_000.0)] = 20_000.0
    max_base_speed_m_s: Annotated[float, between(0.01, 1.0)]
    battery_low_v: Annotated[float, between(0.0, 100.0)] = 0.0
    battery_stop_v: Annotated[float, between(0.0, 100.0)] = 0.0
    self_resume: bool = True
    longest_pause_s: Annotated[float, between(1.0, 86_400.0)] = 600.0

    @model_validator(mode="after")
    def _battery_ordered(self) -> Self:
        if self.battery_stop_v > self.battery_low_v:
            raise ValueError("battery_stop_v must not exceed battery_low_v")
        return self


class TaskSection(Section):
    product: str = Field(min_length=1, max_length=80)
    registration_number: str = Field(max_length=40)
    dilution_percent: Annotated[float, between(0.0, 100.0)]
    operator: str = Field(min_length=1, max_length=80)
    label_cap_ml: Annotated[float, between(1.0, 500_000.0)]
    tank_fill_ml: Annotated[float, between(1.0, 500_000.0)]
    water: bool


class NavigationSection(Section):
    route: str
    row: str | None = None
    landmarks: bool = True
    ahead_m: Annotated[float, between(0.0, 2.0)] = 0.6
    cruise_speed_m_s: Annotated[float, between(0.01, 1.0)] = 0.25
    datum_latitude_deg: Annotated[float, between(-90.0, 90.0)] | None = None
    datum_longitude_deg: Annotated[float, between(-180.0, 180.0)] | None = None
    datum_heading_rad: Radians = 0.0
    geofence_m: tuple[tuple[float, float], ...] | None = None

    @model_validator(mode="after")
    def _datum_whole(self) -> Self:
        if (self.datum_latitude_deg is None) != (self.datum_longitude_deg is None):
            raise ValueError("give datum_latitude_deg and datum_longitude_deg together, or neither")
        return self

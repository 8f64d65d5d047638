"""What a mission is told once, before it begins."""

from __future__ import annotations

from dataclasses import dataclass

from robot.aiming import AimingParameters, ArmModel, Obstacles
from robot.dosing import Caps, DoseRules, FlowModel, PulseLimits
from robot.geometry import Transform
from robot.navigation import Datum, DriveLimits, FixRules, Geofence, Row
from robot.targets import BookParameters, Policy
from robot.vision.light import ExposureBounds, LampPolicy, LightGoals


@dataclass(frozen=True, slots=True)
class DoseSettings:
    """Rules, flow, pulses and caps. ``full_factor`` widens a pulse's model volume to what it can give at the most."""

    rules: DoseRules
    flow: FlowModel
    pulses: PulseLimits
    caps: Caps
    full_factor: float = 1.15
    full_extra_s: float = 0.03


@dataclass(frozen=True, slots=True)
class LightSettings:
    """``adjusts`` whether the exposure may be changed; ``lamp_beyond_s`` see ``lamp_wanted``; ``stops_when_dark``
    whether a stop that is too dark to trust ends the mission instead of being skipped."""

    goals: LightGoals
    bounds: ExposureBounds
    adjusts: bool
    lamp: LampPolicy
    lamp_beyond_s: float
    stops_when_dark: bool


@dataclass(frozen=True, slots=True, eq=False)
class MissionSettings:
    """Geometry, parameters and the row.

    ``base_from_camera`` (left optical frame) and ``base_from_arm`` (URDF root) are the mounts as configured;
    ``rover_body`` is in the arm's base frame; ``supports_m`` (x, y) of the plants' strings or canes in the row frame;
    ``ahead_m`` how far in front of the rover a fruit is still taken at this stop; ``detect_duration_s`` and
    ``plan_duration_s`` are modelled times of that work.
    """

    row: Row
    datum: Datum | None
    fix_rules: FixRules
    landmarks: bool
    base_from_camera: Transform
    base_from_arm: Transform
    arm_model: ArmModel
    rover_body: Obstacles
    supports_m: tuple[tuple[float, float], ...]
    stow_rad: tuple[float, ...]
    aiming: AimingParameters
    book: BookParameters
    policy: Policy
    dose: DoseSettings
    light: LightSettings
    drive: DriveLimits
    track_m: float
    ahead_m: float
    pressure_ready_bar: float
    pressure_timeout_s: float
    detect_duration_s: float
    plan_duration_s: float = 0.08
    stop_timeout_s: float = 5.0
    longest_pause_s: float = 600.0
    geofence: Geofence | None = None

"""From the configuration to what each room wants to be told."""

from __future__ import annotations

import math
import tomllib
from pathlib import Path

from robot import safety
from robot.actuation import HandSettings
from robot.aiming import AimingParameters, ArmModel, RoverBody, parse_urdf
from robot.calibration_file import load_rig
from robot.config import Config
from robot.config.devices import StereoUsbCameraSection
from robot.dosing import Caps, DoseLaw, DoseRules, FlowModel, Hidden, LawKind, PulseLimits, RipenessFactors
from robot.errors import ConfigError
from robot.geometry import Transform, body_from_optical, transform_from_xyz_rpy
from robot.ledger.values import Task
from robot.mission import DoseSettings, LightSettings, MissionSettings
from robot.navigation import Datum, DriveLimits, FixRules, Geofence, Row, parse_route
from robot.package_files import named_file
from robot.targets import BookParameters, Policy, RipenessBorders
from robot.vision.light import ExposureBounds, LampPolicy, LightGoals
from robot.vision.stereo_rig import StereoRig
from robot.vision.values import Ripeness


def load_arm(config: Config, config_path: Path) -> tuple[ArmModel, str]:
    """The arm's model and its URDF text; ``ConfigError`` when they do not fit the configuration."""
    path = named_file(config.arm.urdf, config_path)
    try:
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        raise ConfigError(f"{path}: the arm's URDF cannot be read ({error.strerror}); check arm.urdf") from error
    except UnicodeDecodeError as error:
        raise ConfigError(f"{path}: expected a URDF (XML) in UTF-8, found {error}; mend the file") from error
    model = parse_urdf(text, str(path))
    if len(config.arm.stow_rad) != len(model.joints):
        raise ConfigError(
            f"{config_path}: arm.stow_rad has {len(config.arm.stow_rad)} angles, "
            f"{path} has {len(model.joints)} joints; give one angle a joint"
        )
    for name, angles in (("stow_rad", config.arm.stow_rad), ("ready_rad", config.arm.ready_rad)):
        for joint, angle_rad in zip(model.joints, angles, strict=True):
            if not joint.lower_rad <= angle_rad <= joint.upper_rad:
                raise ConfigError(
                    f"{config_path}: arm.{name}: {joint.name} at {angle_rad} rad is outside its limits "
                    f"{joint.lower_rad:.3f}..{joint.upper_rad:.3f}; correct the angle"
                )
    return model, text


def load_camera(config: Config, config_path: Path) -> StereoRig:
    """The camera's calibration; ``ConfigError`` when it was made at another image size."""
    path = named_file(config.camera.calibration, config_path)
    rig = load_rig(path)
    if rig.image_size != config.camera.image_size_px:
        (width, height), (wide, high) = rig.image_size, config.camera.image_size_px
        raise ConfigError(
            f"{path}: the calibration is for {width}x{height} pixels, the camera gives {wide}x{high} "
            "(camera.image_size_px); calibrate at the size that is used"
        )
    return rig


def load_row(config: Config, config_path: Path) -> Row:
    """The row to treat: the one that the configuration names, else the route's first."""
    path = named_file(config.navigation.route, config_path)
    try:
        with path.open("rb") as stream:
            route = parse_route(tomllib.load(stream))
    except OSError as error:
        raise ConfigError(f"{path}: the route cannot be read ({error.strerror}); check navigation.route") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path}: not valid TOML ({error}); mend that line") from error
    except ValueError as error:
        raise ConfigError(f"{path}: {error}") from error
    rows = {row.name: row for row in route.rows}
    wanted = config.navigation.row or route.rows[0].name
    if wanted not in rows:
        raise ConfigError(f"{config_path}: navigation.row '{wanted}' is not in {path}; it has: {', '.join(rows)}")
    row = rows[wanted]
    if row.side != config.rig.side:
        raise ConfigError(
            f"{path}: row '{row.name}' stands at the {row.side}, the rig faces {config.rig.side} (rig.side); "
            "turn the rig or the rover, or choose another row"
        )
    return row


def mounts(config: Config) -> tuple[Transform, Transform]:
    """(base_from_camera, base_from_arm): left optical frame and URDF root in the base frame."""
    facing = transform_from_xyz_rpy((0, 0, 0), (0, 0, 0.0 if config.rig.side == "left" else math.pi))
    camera_body = transform_from_xyz_rpy(config.rig.camera_xyz_m, config.rig.camera_rpy_rad)
    arm = transform_from_xyz_rpy(config.rig.arm_xyz_m, config.rig.arm_rpy_rad)
    return facing @ camera_body @ body_from_optical(), facing @ arm


def limits(config: Config) -> safety.Limits:
    return safety.Limits(
        max_shot_ml=config.safety.max_shot_ml,
        max_target_ml=config.safety.max_target_ml,
        max_cell_ml=config.safety.max_square_metre_ml,
        max_minute_ml=config.safety.max_minute_ml,
        max_day_ml=config.safety.max_day_ml,
        max_task_ml=config.task.label_cap_ml,
        max_pulse_s=config.dosing.max_pulse_s,
        max_base_speed_m_s=config.safety.max_base_speed_m_s,
        tank_reserve_ml=config.fluid.tank_reserve_ml,
        min_pressure_bar=config.fluid.pressure_ready_fraction * config.fluid.pump_pressure_bar,
        battery_low_v=config.safety.battery_low_v,
        battery_stop_v=config.safety.battery_stop_v,
    )


def hand_settings(config: Config) -> HandSettings:
    return HandSettings(
        stow_rad=config.arm.stow_rad,
        settle_tolerance_rad=config.arm.settle_tolerance_rad,
        settle_s=config.arm.settle_s,
        settle_timeout_s=config.arm.settle_timeout_s,
        pump_lease_s=config.fluid.pump_lease_s,
        meter_ml_per_pulse=config.fluid.meter_ml_per_pulse,
        meter_tolerance=config.fluid.meter_tolerance,
        valve_close_s=config.fluid.valve_close_s,
        tank_reserve_ml=config.fluid.tank_reserve_ml,
        tank_ml=config.fluid.tank_ml,
    )


def task(config: Config, row: Row) -> Task:
    return Task(
        product=config.task.product,
        registration_number=config.task.registration_number,
        dilution_percent=config.task.dilution_percent,
        operator=config.task.operator,
        label_cap_ml=config.task.label_cap_ml,
        tank_fill_ml=config.task.tank_fill_ml,
        water=config.task.water,
        route=row.name,
        config_hash=config.content_hash(),
        seed=config.twin.seed if config.simulated or config.emulated else None,
    )


def ripeness_borders(config: Config) -> RipenessBorders:
    return RipenessBorders(config.targets.turning_from, config.targets.red_from)


def treated(config: Config) -> frozenset[Ripeness]:
    return frozenset(Ripeness(name) for name in config.targets.ripeness)


def dose_rules(config: Config) -> DoseRules:
    dosing = config.dosing
    return DoseRules(
        law=DoseLaw(LawKind(dosing.law), dosing.coefficient, dosing.min_ml, dosing.max_ml),
        factors=RipenessFactors(
            red=dosing.factor.red,
            turning=dosing.factor.turning,
            green=dosing.factor.green,
            treated=treated(config),
            borders=ripeness_borders(config),
        ),
        hidden=Hidden(dosing.hidden),
    )


def datum(config: Config) -> Datum | None:
    """Where the row frame lies on the earth; None when the configuration does not say, then GPS is not used."""
    navigation = config.navigation
    if navigation.datum_latitude_deg is None or navigation.datum_longitude_deg is None:
        return None
    return Datum(navigation.datum_latitude_deg, navigation.datum_longitude_deg, navigation.datum_heading_rad)


def geofence(config: Config, row: Row) -> Geofence | None:
    """The area that the base must not leave; ``ConfigError`` when it is no polygon, or the row is not inside."""
    if config.navigation.geofence_m is None:
        return None
    try:
        fence = Geofence(config.navigation.geofence_m)
    except ValueError as error:
        raise ConfigError(f"navigation.geofence_m: {error}") from error
    for x_m in (0.0, *(stop.x_m for stop in row.stops)):
        if fence.margin_m(x_m, 0.0) <= 0.0:
            raise ConfigError(
                f"navigation.geofence_m: row '{row.name}' leaves it at x = {x_m:g} m; correct the corners"
            )
    return fence


def supports(config: Config, row: Row) -> tuple[tuple[float, float], ...]:
    """(x, y) of every string or cane of the row, row frame."""
    y_m = config.plants.stem_distance_m * (1.0 if row.side == "left" else -1.0)
    spacing_m = config.plants.spacing_m
    count = int(row.length_m / spacing_m)
    return tuple((spacing_m * (0.5 + index), y_m) for index in range(count))


def dose_settings(config: Config) -> DoseSettings:
    return DoseSettings(
        rules=dose_rules(config),
        flow=FlowModel(
            config.fluid.nozzle_flow_ml_s,
            config.fluid.nozzle_pressure_bar,
            config.fluid.valve_open_s,
            config.fluid.valve_close_s,
        ),
        pulses=PulseLimits(config.dosing.min_pulse_s, config.dosing.max_pulse_s),
        caps=Caps(shot_ml=config.safety.max_shot_ml),
    )


def light_settings(config: Config) -> LightSettings:
    camera = config.camera
    mains_hz = camera.mains_hz
    if mains_hz is None:
        mains_hz = camera.power_line_hz if isinstance(camera, StereoUsbCameraSection) else 50
    return LightSettings(
        goals=LightGoals(dark_signal=camera.dark_signal),
        bounds=ExposureBounds(longest_s=camera.max_exposure_s, greatest_gain=camera.max_gain, mains_hz=mains_hz),
        adjusts=camera.exposure == "auto",
        lamp=LampPolicy(camera.lamp),
        lamp_beyond_s=camera.lamp_beyond_s,
        stops_when_dark=camera.when_dark == "stop",
    )


def mission_settings(config: Config, row: Row, arm: ArmModel) -> MissionSettings:
    base_from_camera, base_from_arm = mounts(config)
    camera_m = base_from_arm.inverse().apply(base_from_camera.translation_m)
    max_speed_m_s = config.navigation.cruise_speed_m_s
    return MissionSettings(
        row=row,
        datum=datum(config),
        fix_rules=FixRules(),
        landmarks=config.navigation.landmarks,
        base_from_camera=base_from_camera,
        base_from_arm=base_from_arm,
        arm_model=arm,
        rover_body=RoverBody().obstacles(transform_from_xyz_rpy(config.rig.arm_xyz_m, config.rig.arm_rpy_rad)),
        supports_m=supports(config, row),
        stow_rad=config.arm.stow_rad,
        aiming=AimingParameters(
            cone_half_angle_rad=config.fluid.cone_half_angle_rad,
            camera_m=(float(camera_m[0]), float(camera_m[1]), float(camera_m[2])),
            ready_rad=config.arm.ready_rad,
            cone_fill=config.aiming.cone_fill,
            min_gap_m=config.aiming.min_gap_m,
            collision_margin_m=config.aiming.collision_margin_m,
            max_velocity_rad_s=config.arm.max_velocity_rad_s,
            max_acceleration_rad_s2=config.arm.max_acceleration_rad_s2,
        ),
        book=BookParameters(ripeness=ripeness_borders(config)),
        policy=Policy(
            ripeness=treated(config),
            min_confidence=config.targets.min_confidence,
            sure_confidence=config.targets.sure_confidence,
            min_visible_fraction=config.targets.min_visible,
            min_diameter_m=config.targets.min_diameter_m,
            max_diameter_m=config.targets.max_diameter_m,
            treat_hidden=config.dosing.hidden != "skip",
        ),
        dose=dose_settings(config),
        light=light_settings(config),
        drive=DriveLimits(
            max_speed_m_s=max_speed_m_s,
            max_deceleration_m_s2=min(0.3, config.wheels.max_acceleration_m_s2),
            max_acceleration_m_s2=min(0.3, config.wheels.max_acceleration_m_s2),
        ),
        track_m=config.wheels.track_m,
        ahead_m=config.navigation.ahead_m,
        pressure_ready_bar=config.fluid.pressure_ready_fraction * config.fluid.pump_pressure_bar,
        pressure_timeout_s=config.fluid.pressure_timeout_s,
        detect_duration_s=config.vision.duration_s,
        geofence=geofence(config, row),
        longest_pause_s=config.safety.longest_pause_s,
    )

"""From the sections of arm and inputs to what their drivers are told."""

from __future__ import annotations

from drivers.arm.control_tables import MODELS
from drivers.arm.joints import JointSettings, ServoSettings
from drivers.inputs.modbus import InputsSettings
from drivers.inputs.points import Point, current_loop
from drivers.inputs.profiles import module_named, reference_modules, reference_points
from drivers.modbus_pdu import READ_COILS, READ_DISCRETE_INPUTS, READ_HOLDING, READ_INPUT_REGISTERS
from robot.aiming import ArmModel
from robot.config.devices import DynamixelArmSection, InputPoint, JointServos, ModbusInputsSection
from robot.config.rooms import FluidSection
from robot.errors import ConfigError

_AREAS = {"coils": READ_COILS, "contacts": READ_DISCRETE_INPUTS, "holding": READ_HOLDING, "input": READ_INPUT_REGISTERS}


def servo_joints(section: DynamixelArmSection, model: ArmModel) -> tuple[JointSettings, ...]:
    """The arm's joints as servos, limits from the URDF; ``ConfigError`` when names or servos do not fit."""
    names = [joint.name for joint in model.joints]
    if odd := sorted(set(names) ^ set(section.servos)):
        raise ConfigError(
            f"arm.servos names {', '.join(section.servos)}; the URDF's joints are {', '.join(names)}; correct {odd[0]}"
        )
    return tuple(
        JointSettings(joint.name, _servos(section.servos[joint.name]), joint.lower_rad, joint.upper_rad)
        for joint in model.joints
    )


def _servos(joint: JointServos) -> tuple[ServoSettings, ...]:
    """The first servo as it is told, the second the other way round where it faces the first."""
    if joint.model not in MODELS:
        raise ConfigError(f"arm.servos: unknown model '{joint.model}'; known are {', '.join(MODELS)}")
    return tuple(
        ServoSettings(
            servo_id, joint.model, joint.reversed != (place == 1 and joint.shadow_reversed), joint.zero_tick
        )
        for place, servo_id in enumerate(joint.ids)
    )


def inputs_settings(section: ModbusInputsSection, fluid: FluidSection) -> InputsSettings:
    """Modules and points as configured, else those of the reference rig. ``ValueError`` for what cannot be."""
    if not section.points:
        points = reference_points(
            fluid.tank_ml, 1000.0 / fluid.meter_ml_per_pulse, section.pressure_full_bar, section.battery_full_v
        )
        return InputsSettings(reference_modules(), points, section.timeout_s)
    return InputsSettings(
        tuple(module_named(module.kind, module.unit) for module in section.modules),
        tuple(_point(point) for point in section.points),
        section.timeout_s,
    )


def _point(point: InputPoint) -> Point:
    if point.kind == "4-20ma":
        assert point.full is not None  # the section has seen to it
        return current_loop(point.quantity, point.unit, point.address, point.full)
    return Point(
        point.quantity, point.unit, _AREAS[point.area], point.address, point.kind,
        point.scale, point.offset, point.low, point.high,
    )  # fmt: skip

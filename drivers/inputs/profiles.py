"""The input modules that are known, and the inputs of the reference rig.

Sources: Waveshare wiki, Modbus_RTU_Analog_Input_8CH; WitMotion, register table of the RS-485 inclinometers.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from drivers import modbus_pdu as pdu
from drivers.inputs.points import Module, Point, current_loop
from drivers.modbus_probe import Probe

CURRENT_4_TO_20_MA = 3


def analog_8(unit_id: int, used: int = 8) -> Module:
    """Waveshare Modbus RTU Analog Input 8CH: input registers 0 to 7 in microamperes; the first ``used`` are wired."""
    return Module(
        unit_id,
        "Waveshare Modbus RTU Analog Input 8CH",
        (
            Probe("its own unit id", pdu.READ_HOLDING, 0x4000, own_id=True),
            Probe(
                f"the range 4 to 20 mA on channels 1 to {used}", pdu.READ_HOLDING, 0x1000, used,
                low=CURRENT_4_TO_20_MA, high=CURRENT_4_TO_20_MA,
            ),
            Probe("8 currents in microamperes", pdu.READ_INPUT_REGISTERS, 0, 8, high=25_000),
        ),
    )  # fmt: skip


def digital_8(unit_id: int) -> Module:
    """Eight contacts (discrete inputs 0 to 7), a 32-bit counter of input 8 (input registers 0, 1) and its frequency in
    tenths of a hertz (input register 2).
    """
    return Module(
        unit_id,
        "digital input module with a pulse counter",
        (
            Probe("its own unit id", pdu.READ_HOLDING, 0x4000, own_id=True),
            Probe("8 contacts", pdu.READ_DISCRETE_INPUTS, 0, 8),
            Probe("a counter and its frequency", pdu.READ_INPUT_REGISTERS, 0, 3),
        ),
    )


def inclinometer(unit_id: int) -> Module:
    """WitMotion, RS-485: holding registers 0x3D and 0x3E are roll and pitch, 32768 for 180 degrees."""
    return Module(
        unit_id,
        "WitMotion inclinometer",
        (
            Probe("its own unit id", pdu.READ_HOLDING, 0x001A, own_id=True),
            Probe("roll and pitch", pdu.READ_HOLDING, 0x003D, 2),
        ),
    )


MODULES: dict[str, Callable[[int], Module]] = {
    "analog-8": analog_8,
    "digital-8": digital_8,
    "inclinometer": inclinometer,
}


def module_named(name: str, unit_id: int) -> Module:
    """Raises ``ValueError`` that lists the known ones."""
    if name not in MODULES:
        raise ValueError(f"inputs: unknown module {name!r}; known are {', '.join(MODULES)}")
    return MODULES[name](unit_id)


ANALOG_UNIT, DIGITAL_UNIT, TILT_UNIT = 2, 3, 80
REFERENCE_ANALOG = 3


def reference_modules() -> tuple[Module, ...]:
    """The modules of the reference rig."""
    return analog_8(ANALOG_UNIT, REFERENCE_ANALOG), digital_8(DIGITAL_UNIT), inclinometer(TILT_UNIT)


def reference_points(
    tank_ml: float, flow_meter_pulses_per_l: float, pressure_full_bar: float = 10.0, battery_full_v: float = 40.0
) -> tuple[Point, ...]:
    """Level, pressure and battery on analog channels 1 to 3; e-stop and bumper on digital inputs 1 and 2, the flow
    meter on 8; roll and pitch from the inclinometer.
    """
    pulse_ml = 1000.0 / flow_meter_pulses_per_l
    angle = 2.0 * math.pi / 0x10000
    return (
        Point("estop_pressed", DIGITAL_UNIT, pdu.READ_DISCRETE_INPUTS, 0, "contact"),
        Point("bumper_pressed", DIGITAL_UNIT, pdu.READ_DISCRETE_INPUTS, 1, "contact"),
        current_loop("tank_level_ml", ANALOG_UNIT, 0, tank_ml),
        current_loop("pressure_bar", ANALOG_UNIT, 1, pressure_full_bar),
        current_loop("battery_v", ANALOG_UNIT, 2, battery_full_v),
        Point("flow_total_ml", DIGITAL_UNIT, pdu.READ_INPUT_REGISTERS, 0, "counter", scale=pulse_ml),
        Point("flow_ml_s", DIGITAL_UNIT, pdu.READ_INPUT_REGISTERS, 2, "u16", scale=0.1 * pulse_ml, high=500.0),
        Point("roll_rad", TILT_UNIT, pdu.READ_HOLDING, 0x003D, "i16", scale=angle, low=-math.pi, high=math.pi),
        Point("pitch_rad", TILT_UNIT, pdu.READ_HOLDING, 0x003E, "i16", scale=angle, low=-math.pi, high=math.pi),
    )

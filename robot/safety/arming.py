"""Arming predicates: each that does not hold gives one readable reason."""

from __future__ import annotations

from robot.safety.timing import ARM_STALE_S, ODOMETRY_STALE_S, RELAY_STALE_S, SENSORS_STALE_S, TILT_MAX_RAD
from robot.safety.values import Inputs


def reasons_against_arming(inputs: Inputs | None, now_s: float) -> tuple[str, ...]:
    """Why the machine must not be armed now; () when it may be."""
    if inputs is None:
        return ("not every device has reported yet",)
    return (*stale_reasons(inputs, now_s), *unsafe_reasons(inputs), *_coil_reasons(inputs))


def stale_reasons(inputs: Inputs, now_s: float) -> tuple[str, ...]:
    """Readings that are too old (or from the future) to act on."""
    ages = (
        ("sensors", inputs.sensors_s, SENSORS_STALE_S),
        ("odometry", inputs.odometry_s, ODOMETRY_STALE_S),
        ("arm", inputs.arm_s, ARM_STALE_S),
        ("relay", inputs.relay_s, RELAY_STALE_S),
    )
    return tuple(
        f"{name} reading is {now_s - stamp_s:.2f} s old (limit {limit_s} s)"
        for name, stamp_s, limit_s in ages
        if not -1e-6 <= now_s - stamp_s <= limit_s
    )


def unsafe_reasons(inputs: Inputs) -> tuple[str, ...]:
    """Conditions of the machine itself that forbid motion and spray."""
    conditions = (
        (inputs.estop_pressed, "the e-stop is pressed"),
        (inputs.bumper_pressed, "the bumper is pressed"),
        (not inputs.arm_healthy, "the arm reports a fault or its torque is off"),
        (not inputs.tilt_rad <= TILT_MAX_RAD, f"the rover tilts {inputs.tilt_rad:.2f} rad (limit {TILT_MAX_RAD})"),
    )
    return tuple(reason for holds, reason in conditions if holds)


def _coil_reasons(inputs: Inputs) -> tuple[str, ...]:
    return ("the valve's coil reads on",) if inputs.valve_coil else ()

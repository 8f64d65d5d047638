"""Arming predicates: each that does not hold gives one readable reason."""

from __future__ import annotations

from robot.safety.catalogue import Action
from robot.safety.failsafe import kind_of
from robot.safety.timing import (
    ARM_STALE_S,
    ODOMETRY_STALE_S,
    RELAY_STALE_S,
    SELF_RESUME_MAX_M,
    SENSORS_STALE_S,
    TILT_MAX_RAD,
)
from robot.safety.values import Inputs, SafetyState


def reasons_against_arming(
    state: SafetyState, inputs: Inputs | None, now_s: float, first: bool
) -> tuple[str, ...]:
    """Why the machine must not be armed, started or operated now; () when it may be. ``first``: the step to READY,
    at which the pump must be off as well."""
    if inputs is None:
        return (*standing_reasons(state), "not every device has reported yet")
    coils = ((inputs.valve_coil, "the valve's coil reads on"), (first and inputs.pump_coil, "the pump's coil reads on"))
    return (
        *standing_reasons(state),
        *stale_reasons(inputs, now_s),
        *unsafe_reasons(inputs),
        *(reason for holds, reason in coils if holds),
    )


def reasons_against_resuming(
    state: SafetyState, inputs: Inputs | None, now_s: float, by_itself: bool
) -> tuple[str, ...]:
    """Why a pause must not end now. ``by_itself``: without an operator."""
    reasons = reasons_against_arming(state, inputs, now_s, first=False)
    if not by_itself:
        return reasons
    if not state.self_resume:
        reasons += ("this pause ends by an operator only",)
    if inputs is not None and not inputs.moved_since_pause_m <= SELF_RESUME_MAX_M:
        reasons += (f"the base moved {inputs.moved_since_pause_m:.2f} m while paused (limit {SELF_RESUME_MAX_M} m)",)
    return reasons


def standing_reasons(state: SafetyState, least: Action = Action.PAUSE) -> tuple[str, ...]:
    """Active faults whose action is ``least`` or more severe."""
    return tuple(f"{fault.text} [{fault.id}]" for fault in state.faults if kind_of(fault.id).action >= least)


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

"""Faults that the readings themselves show."""

from __future__ import annotations

from dataclasses import replace

from robot.safety.faults import clear_fault, report_fault
from robot.safety.lease import lease_reasons
from robot.safety.limits import Limits
from robot.safety.timing import COAST_S, ROLLING_M_S, TILT_STOP_RAD
from robot.safety.values import Inputs, Mode, SafetyState

_ENERGISED = (Mode.READY, Mode.AUTO, Mode.MANUAL, Mode.PAUSED)
MONITORED = ("F08", "F12", "F13", "F21", "F59", "F63", "F64", "F65", "F69", "F69b", "F70i", "F70l")


def watch(state: SafetyState, inputs: Inputs, limits: Limits, now_s: float) -> SafetyState:
    """Report every fault that the newest readings show, and clear each that they show no more."""
    state = replace(state, rolling_since_s=_rolling_since(state, inputs, now_s))
    shown = _shown(state, inputs, limits, now_s)
    for fault_id in MONITORED:
        if (text := shown.get(fault_id)) is not None:
            state = report_fault(state, fault_id, text, now_s)
        else:
            state = clear_fault(state, fault_id)
    return state


def _shown(state: SafetyState, inputs: Inputs, limits: Limits, now_s: float) -> dict[str, str]:
    energised = state.mode in _ENERGISED
    shot = any(booking.pending for booking in state.bookings)
    rolls_on = state.rolling_since_s is not None and now_s - state.rolling_since_s > COAST_S
    lease = lease_reasons(state, now_s) if state.mode is Mode.MANUAL else ()
    errors = " ".join(f"0x{error:02x}" for error in inputs.arm_errors)
    empty_ml = limits.tank_reserve_ml + limits.max_shot_ml
    conditions = (
        ("F08", energised and inputs.valve_coil and not shot, "the valve's coil reads on though nobody opened it"),
        ("F12", energised and any(inputs.arm_errors),
         f"the servos of the arm report the errors {errors}: let it cool down, look for what blocks it"),
        ("F13", energised and not inputs.arm_torque_on, "the arm has lost its torque: a servo started anew"),
        ("F21", energised and rolls_on,
         f"the base rolls at {inputs.base_speed_m_s:.2f} m/s though it was told to stand still"),
        ("F59", energised and inputs.bumper_pressed, "the bumper was pressed"),
        ("F63", energised and state.mode is not Mode.MANUAL and not inputs.fence_margin_m >= 0.0,
         f"the rover is {-inputs.fence_margin_m:.2f} m outside of the geofence"),
        ("F64", energised and not inputs.tilt_rad <= TILT_STOP_RAD,
         f"the rover tilts {inputs.tilt_rad:.2f} rad (stops at {TILT_STOP_RAD:.2f})"),
        ("F65", state.mode in (Mode.AUTO, Mode.PAUSED) and not inputs.tank_left_ml >= empty_ml,
         f"the tank holds {inputs.tank_left_ml:.0f} ml (reserve {limits.tank_reserve_ml:.0f}): refill it"),
        ("F69", energised and not inputs.battery_v >= limits.battery_low_v,
         f"the battery is at {inputs.battery_v:.1f} V (low below {limits.battery_low_v:.1f}): charge it"),
        ("F69b", energised and not inputs.battery_v >= limits.battery_stop_v,
         f"the battery is at {inputs.battery_v:.1f} V (empty below {limits.battery_stop_v:.1f}): charge it"),
        ("F70i", bool(lease), "; ".join(lease)),
        ("F70l", inputs.estop_pressed, "the e-stop was pressed"),
    )  # fmt: skip
    return {fault_id: text for fault_id, holds, text in conditions if holds}


def _rolling_since(state: SafetyState, inputs: Inputs, now_s: float) -> float | None:
    if inputs.base_commanded or abs(inputs.base_speed_m_s) <= ROLLING_M_S:
        return None
    return now_s if state.rolling_since_s is None else state.rolling_since_s

"""The gate: every command that can move or spray is authorised here, default deny."""

from __future__ import annotations

import math
from dataclasses import replace

from robot.safety.arming import stale_reasons, standing_reasons, unsafe_reasons
from robot.safety.catalogue import Action
from robot.safety.lease import lease_reasons
from robot.safety.limits import Limits
from robot.safety.timing import BASE_STILL_M_S, FENCE_DRIVE_BACK_M_S, FRAME_MOTION_MAX_M, MINUTE_S
from robot.safety.values import Booking, Decision, Inputs, Mode, MotionRequest, SafetyState, SprayRequest


def authorise_motion(
    state: SafetyState, inputs: Inputs | None, request: MotionRequest, limits: Limits, now_s: float
) -> Decision:
    """May the base drive, or the arm move, now? A base command of zero is a stop and always allowed."""
    if request.part == "base" and request.speed_m_s == 0.0 and request.yaw_rate_rad_s == 0.0:
        return Decision(())
    reasons = _mode_reasons(state, inputs, now_s, Action.PAUSE)
    if inputs is not None and (inputs.valve_coil or any(booking.pending for booking in state.bookings)):
        reasons += ("the valve is open or a shot is under way",)
    if request.part == "base":
        reasons += _base_reasons(state, inputs, request, limits)
    elif request.part == "arm":
        reasons += _base_moving_reasons(inputs)
    else:
        reasons += (f"unknown part '{request.part}'",)
    return Decision(reasons)


def authorise_spray(
    state: SafetyState, inputs: Inputs | None, request: SprayRequest, limits: Limits, now_s: float
) -> tuple[SafetyState, Decision]:
    """May the valve open now? When it may, the full pulse is booked as pending in the state that is returned."""
    reasons = _mode_reasons(state, inputs, now_s, Action.INHIBIT_SPRAY) + _base_moving_reasons(inputs)
    if inputs is not None:
        conditions = (
            (not inputs.arm_settled, "the arm has not settled"),
            (not inputs.moved_since_frame_m <= FRAME_MOTION_MAX_M,
             f"the base moved {inputs.moved_since_frame_m * 1000:.0f} mm since the target was seen"),
            (not inputs.pressure_bar >= limits.min_pressure_bar,
             f"pressure is {inputs.pressure_bar:.2f} bar (needs {limits.min_pressure_bar:.2f})"),
            (not inputs.tank_left_ml - request.full_ml >= limits.tank_reserve_ml,
             f"the tank holds {inputs.tank_left_ml:.0f} ml (reserve {limits.tank_reserve_ml:.0f})"),
            (inputs.valve_coil, "the valve's coil reads on"),
        )
        reasons += tuple(reason for holds, reason in conditions if holds)
    reasons += _cap_reasons(state, request, limits, now_s)
    if reasons:
        return state, Decision(reasons)
    number = max((booking.number for booking in state.bookings), default=0) + 1
    booking = Booking(number, now_s, request.target_id, request.full_ml, pending=True, cell=request.cell)
    return replace(state, bookings=(*state.bookings, booking)), Decision(())


def still_allowed(state: SafetyState, inputs: Inputs | None, now_s: float) -> Decision:
    """The last look between the intent's commit and the frame that opens the valve."""
    reasons = _mode_reasons(state, inputs, now_s, Action.INHIBIT_SPRAY) + _base_moving_reasons(inputs)
    if inputs is not None and not inputs.arm_settled:
        reasons += ("the arm has not settled",)
    return Decision(reasons)


def settle_booking(state: SafetyState, target_id: int, ml: float, now_s: float) -> SafetyState:
    """Replace the pending booking of a target by what was booked in the ledger."""
    bookings = tuple(
        replace(booking, ml=ml, pending=False, stamp_s=now_s)
        if booking.pending and booking.target_id == target_id
        else booking
        for booking in state.bookings
    )
    return replace(state, bookings=bookings)


def _mode_reasons(state: SafetyState, inputs: Inputs | None, now_s: float, least: Action) -> tuple[str, ...]:
    """Mode, lease, faults whose action is ``least`` or more severe, and readings."""
    reasons: tuple[str, ...] = ()
    if state.mode not in (Mode.AUTO, Mode.MANUAL):
        reasons += (f"mode is {state.mode}", *state.causes)
    if state.mode is Mode.MANUAL:
        reasons += lease_reasons(state, now_s)
    reasons += standing_reasons(state, least)
    if inputs is None:
        return (*reasons, "not every device has reported yet")
    return reasons + stale_reasons(inputs, now_s) + unsafe_reasons(inputs)


def _base_reasons(
    state: SafetyState, inputs: Inputs | None, request: MotionRequest, limits: Limits
) -> tuple[str, ...]:
    reasons: tuple[str, ...] = ()
    if inputs is not None and not inputs.arm_stowed:
        reasons += ("the arm is not stowed",)
    if not (math.isfinite(request.speed_m_s) and abs(request.speed_m_s) <= limits.max_base_speed_m_s):
        reasons += (f"base speed {request.speed_m_s} m/s is over the limit of {limits.max_base_speed_m_s}",)
    if inputs is not None and not inputs.fence_margin_m >= 0.0:
        by_hand = state.mode is Mode.MANUAL
        if not (by_hand and abs(request.speed_m_s) <= FENCE_DRIVE_BACK_M_S):
            reasons += (
                f"the rover is {-inputs.fence_margin_m:.2f} m outside of the geofence: drive it back by hand, "
                f"at {FENCE_DRIVE_BACK_M_S} m/s at most",
            )
    if not math.isfinite(request.yaw_rate_rad_s):
        reasons += (f"yaw rate {request.yaw_rate_rad_s} is not a number",)
    return reasons


def _base_moving_reasons(inputs: Inputs | None) -> tuple[str, ...]:
    if inputs is None:
        return ()
    still = not inputs.base_commanded and abs(inputs.base_speed_m_s) <= BASE_STILL_M_S
    return () if still else ("the base is moving",)


def _cap_reasons(state: SafetyState, request: SprayRequest, limits: Limits, now_s: float) -> tuple[str, ...]:
    numbers = (request.dose_ml, request.full_ml, request.open_s, request.pulse_s)
    if not all(math.isfinite(number) and number > 0.0 for number in numbers):
        return (f"the request {request} is not made of positive numbers",)
    given, run_ml = state.given, sum(b.ml for b in state.bookings)
    target_ml = dict(given.target_ml).get(request.target_id, 0.0)
    target_ml += sum(b.ml for b in state.bookings if b.target_id == request.target_id)
    minute_ml = sum(b.ml for b in state.bookings if b.pending or now_s - b.stamp_s < MINUTE_S)
    minute_ml += sum(ml for stamp_s, ml in given.recent if now_s - stamp_s < MINUTE_S)
    cell_ml = 0.0
    if request.cell is not None:
        cell_ml = dict(given.cell_ml).get(request.cell, 0.0)
        cell_ml += request.full_ml + sum(b.ml for b in state.bookings if b.cell == request.cell)
    caps = (
        ("pulse", request.pulse_s, limits.max_pulse_s, "s"),
        ("opening", request.open_s, request.pulse_s, "s"),
        ("shot", request.dose_ml, limits.max_shot_ml, "ml"),
        ("target", target_ml + request.full_ml, limits.max_target_ml, "ml"),
        ("square metre", cell_ml, limits.max_cell_ml, "ml"),
        ("rolling minute", minute_ml + request.full_ml, limits.max_minute_ml, "ml"),
        ("task", given.task_ml + run_ml + request.full_ml, limits.max_task_ml, "ml"),
        ("day", given.day_ml + run_ml + request.full_ml, limits.max_day_ml, "ml"),
    )
    over = tuple(
        f"{name}: {value:.2f} {unit} is over the cap of {cap:.2f}" for name, value, cap, unit in caps
        if value > cap + 1e-9
    )
    return over + (("a shot is under way",) if any(b.pending for b in state.bookings) else ())

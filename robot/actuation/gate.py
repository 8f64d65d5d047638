"""Safety's state of this run, and the questions that every command must pass."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import replace

from robot import safety
from robot.actuation.readings import Readings
from robot.actuation.values import Refused

NO_TARGET = -1


class Gate:
    """Holds what ``robot.safety`` remembers, and asks it with the newest readings. ``Refused`` carries its reasons."""

    def __init__(
        self, readings: Readings, limits: safety.Limits, on_mode: Callable[[safety.SafetyState], None]
    ) -> None:
        self._readings = readings
        self._limits = limits
        self._on_mode = on_mode
        self.state = safety.SafetyState()

    def begin_task(self, given: safety.Given) -> None:
        """What earlier runs gave counts for the caps."""
        self.state = replace(self.state, bookings=(), given=given)

    def change_mode(self, verb: safety.Verb, cause: str) -> safety.Decision:
        state, decision = safety.change_mode(self.state, verb, cause, self._readings.inputs(), now_s())
        self._enter(state)
        return decision

    def take_up(self, former: safety.SafetyState) -> None:
        """Go on in the latch that an earlier run ended in, before anything is asked."""
        self._enter(replace(self.state, mode=former.mode, causes=former.causes))

    def report(self, fault_id: str, text: str) -> None:
        """Take a fault of the catalogue in, with its effect on the mode."""
        self._enter(safety.report_fault(self.state, fault_id, text, now_s()))

    def clear(self, fault_id: str) -> None:
        self._enter(safety.clear_fault(self.state, fault_id))

    def watch(self) -> None:
        """Report and clear what the newest readings show."""
        inputs = self._readings.inputs()
        if inputs is not None:
            self._enter(safety.watch(self.state, inputs, self._limits, now_s()))

    def take_lease(self, holder: str, take_over: bool) -> safety.Decision:
        self.state, decision = safety.take_lease(self.state, holder, now_s(), take_over)
        return decision

    def beat_lease(self, holder: str) -> safety.Decision:
        self.state, decision = safety.beat_lease(self.state, holder, now_s())
        return decision

    def release_lease(self, holder: str) -> None:
        self.state = safety.release_lease(self.state, holder)

    def _enter(self, state: safety.SafetyState) -> None:
        before, self.state = self.state, state
        if state.mode is safety.Mode.PAUSED and before.mode is not safety.Mode.PAUSED:
            self._readings.pause_mark = self._readings.odometry
        if (state.mode, state.causes, state.faults) != (before.mode, before.causes, before.faults):
            self._on_mode(state)

    def demand_motion(self, request: safety.MotionRequest) -> None:
        inputs = self._readings.inputs()
        _demand(safety.authorise_motion(self.state, inputs, request, self._limits, now_s()))

    @property
    def armed(self) -> bool:
        return self.state.mode in (safety.Mode.AUTO, safety.Mode.MANUAL)

    def demand_armed(self) -> None:
        _demand(safety.Decision(() if self.armed else (f"mode is {self.state.mode}", *self.state.causes)))

    def demand_spray(self, request: safety.SprayRequest) -> None:
        """When it is allowed, the full pulse counts as given from here on, until ``settle`` tells better."""
        inputs = self._readings.inputs()
        self.state, decision = safety.authorise_spray(self.state, inputs, request, self._limits, now_s())
        _demand(decision)

    def last_look(self) -> safety.Decision:
        return safety.still_allowed(self.state, self._readings.inputs(), now_s())

    def book_leak(self, ml: float) -> None:
        """Liquid that reached no target counts for the caps of task, day and minute, and is gone from the tank."""
        number = max((booking.number for booking in self.state.bookings), default=0) + 1
        booking = safety.Booking(number, now_s(), NO_TARGET, ml, pending=False)
        self.state = replace(self.state, bookings=(*self.state.bookings, booking))
        self._readings.tank_left_ml -= ml

    def stands(self, fault_id: str) -> bool:
        """Whether this fault is active."""
        return any(fault.id == fault_id for fault in self.state.faults)

    def settle(self, target_id: int, booked_ml: float) -> None:
        self.state = safety.settle_booking(self.state, target_id, booked_ml, now_s())
        self._readings.tank_left_ml -= booked_ml


def now_s() -> float:
    return asyncio.get_running_loop().time()


def _demand(decision: safety.Decision) -> None:
    if not decision.allowed:
        raise Refused("; ".join(decision.reasons))

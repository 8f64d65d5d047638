"""Safety's state of this run, and the questions that every command must pass."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from robot import safety
from robot.actuation.readings import Readings
from robot.actuation.values import Refused


class Gate:
    """Holds what ``robot.safety`` remembers, and asks it with the newest readings. ``Refused`` carries its reasons."""

    def __init__(
        self, readings: Readings, limits: safety.Limits, on_mode: Callable[[safety.SafetyState], None]
    ) -> None:
        self._readings = readings
        self._limits = limits
        self._on_mode = on_mode
        self.state = safety.SafetyState()

    def begin_task(self, task_ml: float, target_ml: dict[int, float]) -> None:
        """What earlier runs of the task gave counts for its caps."""
        mode, causes = self.state.mode, self.state.causes
        self.state = safety.SafetyState(mode, causes, (), task_ml, tuple(sorted(target_ml.items())))

    def change_mode(self, verb: safety.Verb, cause: str) -> safety.Decision:
        state, decision = safety.change_mode(self.state, verb, cause, self._readings.inputs(), now_s())
        if state is not self.state:
            self.state = state
            self._on_mode(state)
        return decision

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

    def settle(self, target_id: int, booked_ml: float) -> None:
        self.state = safety.settle_booking(self.state, target_id, booked_ml, now_s())
        self._readings.tank_left_ml -= booked_ml


def now_s() -> float:
    return asyncio.get_running_loop().time()


def _demand(decision: safety.Decision) -> None:
    if not decision.allowed:
        raise Refused("; ".join(decision.reasons))

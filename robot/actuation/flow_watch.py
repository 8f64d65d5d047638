"""Remembers how much the meter saw of each whole shot, and says when the nozzle must be seen to."""

from __future__ import annotations

from robot.actuation import values
from robot.actuation.gate import now_s
from robot.actuation.readings import Readings
from robot.clock import work
from robot.dosing.flow_check import OVER_SHOTS, FlowHistory, tank_problem
from robot.ledger import Ledger
from robot.ledger.values import Outcome, Result


class FlowWatch:
    """The history outlives the program; it begins anew when something was found, and when an operator says so."""

    def __init__(self, ledger: Ledger, resolution_ml: float) -> None:
        self._ledger = ledger
        self._resolution_ml = resolution_ml
        self._history = FlowHistory(resolution_ml)
        self.dry = False  # the last shot drew air, or nothing came through

    async def begin(self) -> None:
        """With the history of earlier runs. Alone it keeps nobody from a first shot: that one tells."""
        earlier = await work(lambda: self._ledger.flow_history(OVER_SHOTS), values.LEDGER_WRITE_S)
        for model_ml, measured_ml in earlier:
            self._history = self._history.with_shot(model_ml, measured_ml)

    def take(self, model_ml: float, result: Result, readings: Readings) -> str:
        """What is wrong after a shot that ended, "" when nothing is. Only a whole, measured shot tells something."""
        self.dry = False
        if result.measured_ml is None or result.outcome not in (Outcome.SPRAYED, Outcome.UNCERTAIN):
            return ""
        self._history = self._history.with_shot(model_ml, result.measured_ml)
        problem, self.dry = self._history.problem, self._history.dry
        if problem:
            self._history = FlowHistory(self._resolution_ml)
        if self.dry and readings.sensors is not None:
            level_ml, reserve_ml = readings.sensors.tank_level_ml, readings.settings.tank_reserve_ml
            tank = tank_problem(readings.tank_left_ml, level_ml, reserve_ml)
            problem = f"{problem}; {tank}" if tank else problem
        return problem

    async def checked(self, operator: str) -> None:
        """An operator has seen to the nozzle: what came before no longer counts, after a restart neither."""
        stamp_s = now_s()
        text = f"seen to by {operator}"
        await work(lambda: self._ledger.record_event("nozzle", text, stamp_s), values.LEDGER_WRITE_S)
        self._history = FlowHistory(self._resolution_ml)

"""Remembers how much the meter saw of each whole shot, and says when nozzle or tank must be seen to."""

from __future__ import annotations

from robot.actuation import values
from robot.actuation.gate import now_s
from robot.actuation.readings import Readings
from robot.clock import work
from robot.dosing.flow_check import OVER_SHOTS, FlowHistory, tank_problem
from robot.ledger import Ledger
from robot.ledger.values import Outcome, Result


class FlowWatch:
    """``problem`` keeps the valve shut until an operator has seen to the nozzle. The history outlives the program."""

    def __init__(self, ledger: Ledger, resolution_ml: float) -> None:
        self._ledger = ledger
        self._resolution_ml = resolution_ml
        self._history = FlowHistory(resolution_ml)
        self._tank = ""
        self.problem = ""

    @property
    def dry(self) -> bool:
        return self._history.dry

    @property
    def faults(self) -> dict[str, str]:
        """By their number in the catalogue."""
        found = {"F65": self._tank, "F66": self.problem}
        return {number: text for number, text in found.items() if text}

    async def begin(self) -> None:
        """With the history of earlier runs. Alone it keeps nobody from a first shot: that one tells."""
        earlier = await work(lambda: self._ledger.flow_history(OVER_SHOTS), values.LEDGER_WRITE_S)
        for model_ml, measured_ml in earlier:
            self._history = self._history.with_shot(model_ml, measured_ml)

    def take(self, model_ml: float, result: Result, readings: Readings) -> None:
        """A shot that ended. Only a whole one that was measured tells something of the nozzle."""
        if result.measured_ml is None or result.outcome not in (Outcome.SPRAYED, Outcome.UNCERTAIN):
            return
        self._history = self._history.with_shot(model_ml, result.measured_ml)
        self.problem = self._history.problem
        level_ml = readings.sensors.tank_level_ml if readings.sensors is not None else 0.0
        self._tank = tank_problem(readings.tank_left_ml, level_ml, readings.settings.tank_reserve_ml)
        if self._history.dry and self._tank:
            self.problem = f"{self.problem}; {self._tank}"

    async def checked(self, operator: str) -> None:
        stamp_s = now_s()
        text = f"seen to by {operator}; before: {self.problem or 'no complaint'}"
        await work(lambda: self._ledger.record_event("nozzle", text, stamp_s), values.LEDGER_WRITE_S)
        self._history = FlowHistory(self._resolution_ml)
        self.problem = ""

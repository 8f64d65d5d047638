"""Pump, valve, nozzle and tank: pressure builds up, the valve moves late, flow follows the root of pressure."""

from __future__ import annotations

import math
from dataclasses import dataclass

from drivers.twin.deviations import TrueMachine
from drivers.twin.faults import Verb
from drivers.twin.nominal import Nominal

SLICE_S = 0.020
BLEED_CLOSED_S = 4.0  # time constant of the pressure without the pump
BLEED_OPEN_S = 0.15
LEAK_SHARE = 0.02  # of the full flow, through a valve that does not seal
SLOW_FACTOR = 10.0
_GAUSS = ((0.5 - math.sqrt(0.15), 5 / 18), (0.5, 8 / 18), (0.5 + math.sqrt(0.15), 5 / 18))


@dataclass(frozen=True, slots=True)
class Flowed:
    """A slice of flow from ``from_s`` to ``to_s``; ``leaked`` when the valve should have been shut."""

    from_s: float
    to_s: float
    ml: float
    leaked: bool


class Hydraulics:
    """Pressure is first order towards the relief valve's setting; between switchings everything has a closed form.

    ``total_ml`` left the nozzle so far; ``tank_ml`` is what the tank still holds.
    """

    def __init__(self, nominal: Nominal, true: TrueMachine) -> None:
        self._flow_ml_s = true.nozzle_flow_ml_s
        self._reference_bar = nominal.nozzle_pressure_bar
        self._relief_bar = nominal.pump_pressure_bar
        self._rise_s = nominal.pump_rise_s
        self._open_s = true.valve_open_s
        self._close_s = true.valve_close_s
        self.tank_ml = nominal.tank_fill_ml
        self.total_ml = 0.0
        self.valve_open = False
        self.valve_fault = Verb.OK
        self.pump_on = False
        self._coil_on = False
        self._moves: list[tuple[float, bool]] = []  # due valve movements, in order of time
        self._anchor_s, self._anchor_bar = 0.0, 0.0
        self._slice_start_s = 0.0

    @property
    def next_s(self) -> float:
        """When the valve next moves or the present slice of flow ends."""
        move_s = self._moves[0][0] if self._moves else math.inf
        slice_end_s = math.inf
        if self.opening > 0.0:
            slice_end_s = (math.floor(self._slice_start_s / SLICE_S + 1e-6) + 1) * SLICE_S
        return min(move_s, slice_end_s)

    @property
    def opening(self) -> float:
        """Share of the full flow that the valve lets through."""
        if self.valve_open:
            return 1.0
        return LEAK_SHARE if self.valve_fault is Verb.WRONG else 0.0

    @property
    def resting(self) -> bool:
        """No liquid moves and none will without a new command."""
        return self.opening == 0.0 and not self._moves

    def pressure_bar(self, t_s: float) -> float:
        goal_bar = self._relief_bar if self.pump_on else 0.0
        rise_s = self._rise_s if self.pump_on else BLEED_OPEN_S if self.valve_open else BLEED_CLOSED_S
        return goal_bar + (self._anchor_bar - goal_bar) * math.exp(-(t_s - self._anchor_s) / rise_s)

    def flow_ml_s(self, t_s: float) -> float:
        if self.tank_ml <= 0.0:
            return 0.0
        return self.opening * self._flow_ml_s * math.sqrt(self.pressure_bar(t_s) / self._reference_bar)

    def dispensed_ml(self, t_s: float) -> float:
        """What left the nozzle until now, the present slice included."""
        return self.total_ml + self._slice_ml(t_s)

    def set_pump(self, t_s: float, on: bool) -> Flowed | None:
        """Power to the pump; returns the flow until now. All calls come in order of time."""
        if on == self.pump_on:
            return None
        flowed = self._end_slice(t_s)
        self._re_anchor(t_s)
        self.pump_on = on
        return flowed

    def set_valve_coil(self, t_s: float, on: bool) -> None:
        """Power to the valve's coil; the valve follows after its latency, a shorter power than that moves nothing."""
        if on == self._coil_on:
            return
        self._coil_on = on
        if self.valve_fault is Verb.STUCK or (on and self.valve_fault is Verb.OFF):
            return
        latency_s = (self._open_s if on else self._close_s) * (SLOW_FACTOR if self.valve_fault is Verb.SLOW else 1.0)
        due_s = t_s + latency_s
        self._moves = [move for move in self._moves if move[0] < due_s]
        self._moves.append((due_s, on))

    def set_valve_fault(self, t_s: float, fault: Verb) -> Flowed | None:
        """The valve itself breaks or mends; a mended one goes where its coil asks. Returns the flow until now.

        OFF: it stays shut; STUCK: it stays where it is; WRONG: it does not seal; SLOW: its latencies are longer.
        """
        if fault is self.valve_fault:
            return None
        flowed = self._end_slice(t_s)
        was, self.valve_fault = self.valve_fault, fault
        if fault is Verb.OFF:
            self._moves = [(t_s, False)]
        elif fault is Verb.STUCK:
            self._moves = []
        elif was in (Verb.OFF, Verb.STUCK):
            self._moves = [(t_s, self._coil_on)]
        return flowed

    def refill(self, t_s: float, tank_ml: float) -> Flowed | None:
        """The tank now holds ``tank_ml``; returns the flow until now."""
        flowed = self._end_slice(t_s)
        self.tank_ml = tank_ml
        return flowed

    def step(self, t_s: float) -> tuple[Flowed | None, bool | None]:
        """Do what is due at ``t_s``: the flow of the slice that ends, and the valve's new place if it moved."""
        flowed = self._end_slice(t_s) if self.next_s <= t_s else None
        moved = None
        while self._moves and self._moves[0][0] <= t_s:
            _, is_open = self._moves.pop(0)
            if is_open != self.valve_open:
                self._re_anchor(t_s)
                self.valve_open = moved = is_open
                self._slice_start_s = t_s
        return flowed, moved

    def _re_anchor(self, t_s: float) -> None:
        self._anchor_bar, self._anchor_s = self.pressure_bar(t_s), t_s

    def _end_slice(self, t_s: float) -> Flowed | None:
        ml = self._slice_ml(t_s)
        flowed = Flowed(self._slice_start_s, t_s, ml, not self.valve_open) if ml > 0.0 else None
        self.total_ml += ml
        self.tank_ml = max(0.0, self.tank_ml - ml)
        self._slice_start_s = t_s
        return flowed

    def _slice_ml(self, t_s: float) -> float:
        """Since the slice began, by three-point Gauss quadrature; no switching lies inside a slice."""
        if self.opening == 0.0 or t_s <= self._slice_start_s:
            return 0.0
        span_s = t_s - self._slice_start_s
        ml = span_s * sum(share * self.flow_ml_s(self._slice_start_s + at * span_s) for at, share in _GAUSS)
        return min(ml, self.tank_ml)

"""From the cups of a catch test to a flow model that may be trusted, or to the cup that spoils it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from robot.dosing.flow import FlowFit, fit_flow
from robot.geometry import Vector

LEAST_LENGTHS = 4          # three points lie on a line too easily, and do not tell which of them is wrong
LEAST_R2 = 0.995
ODD_ML, ODD_SHARE = 0.25, 0.06
PLAUSIBLE_DEAD_S = (-0.1, 0.15)
PLAUSIBLE_FLOW_ML_S = (0.5, 200.0)


@dataclass(frozen=True, slots=True)
class Catch:
    """One cup: ``pulses`` openings of ``open_s`` gave ``caught_ml`` together; pressure is the mean before them.

    ``counted_ml`` is the flow meter's figure, None without one.
    """

    open_s: float
    pulses: int
    caught_ml: float
    pressure_bar: float
    counted_ml: float | None = None

    @property
    def pulse_ml(self) -> float:
        return self.caught_ml / self.pulses


@dataclass(frozen=True, slots=True)
class CatchFit:
    """The line through the cups (residuals in millilitres a pulse, one a cup) and its coefficient of determination."""

    flow: FlowFit
    r2: float


def fit_catches(catches: Sequence[Catch], pressure_bar: float, close_latency_s: float) -> CatchFit:
    """Slope and offset of ml = Q * (open_s - dead time), each cup brought to ``pressure_bar`` by the root law first.

    ``ValueError`` names the cup that does not lie on the line with the others, or the figure that cannot be.
    """
    cups = sorted(catches, key=lambda cup: cup.open_s)
    for cup in cups:
        if not (math.isfinite(cup.caught_ml) and cup.caught_ml > 0.0 and cup.pressure_bar > 0.0):
            raise ValueError(f"{_name(cup)}: expected millilitres and a pressure above 0, found {cup}")
    lengths = len({cup.open_s for cup in cups})
    if lengths < LEAST_LENGTHS:
        raise ValueError(f"a catch test needs {LEAST_LENGTHS} pulse lengths or more, found {lengths}")
    open_s = np.array([cup.open_s for cup in cups])
    pulse_ml = np.array([cup.pulse_ml * math.sqrt(pressure_bar / cup.pressure_bar) for cup in cups])
    odd, beside_ml = _odd_one_out(open_s, pulse_ml)
    spoilt = f"{_name(cups[odd])} lies {beside_ml:+.2f} ml a pulse beside the line through the others; catch it again"
    if (np.diff(pulse_ml)[np.diff(open_s) > 0.0] <= 0.0).any():
        raise ValueError(f"longer pulses did not always give more: {spoilt}")
    try:
        fit = fit_flow(open_s.tolist(), pulse_ml.tolist(), pressure_bar, close_latency_s)
    except ValueError as error:
        raise ValueError(f"{error}; {spoilt}") from error
    r2 = 1.0 - float(np.sum(np.square(fit.residual_ml)) / np.sum(np.square(pulse_ml - pulse_ml.mean())))
    if r2 < LEAST_R2:
        raise ValueError(f"the catches do not lie on a line (r2 {r2:.4f}, needs {LEAST_R2:g}): {spoilt}")
    if abs(beside_ml) > max(ODD_ML, ODD_SHARE * pulse_ml[odd]):
        raise ValueError(f"one catch does not lie on the line: {spoilt}")
    low, high = PLAUSIBLE_DEAD_S
    if not low <= fit.dead_time_s <= high:
        raise ValueError(
            f"a dead time of {fit.dead_time_s:.3f} s is not plausible ({low:g} to {high:g} s); check the number of "
            "pulses in a cup, the unit, and the nozzle for dripping"
        )
    low, high = PLAUSIBLE_FLOW_ML_S
    if not low <= fit.model.flow_ml_s <= high:
        raise ValueError(
            f"a flow of {fit.model.flow_ml_s:.3g} ml/s is not plausible ({low:g} to {high:g}); check the unit"
        )
    return CatchFit(fit, r2)


def meter_ml_per_pulse(catches: Sequence[Catch], configured_ml: float) -> float | None:
    """What one pulse of the flow meter stands for by these catches; None when it counted nothing."""
    counted_ml = sum(cup.counted_ml or 0.0 for cup in catches)
    caught_ml = sum(cup.caught_ml for cup in catches)
    return configured_ml * caught_ml / counted_ml if counted_ml > 0.0 else None


def _odd_one_out(open_s: Vector, pulse_ml: Vector) -> tuple[int, float]:
    """The cup without which the others lie best on a line, and how far it is from that line."""
    best, beside_ml, least_ml2 = 0, 0.0, math.inf
    for k in range(len(open_s)):
        others = np.arange(len(open_s)) != k
        slope, offset = np.polyfit(open_s[others], pulse_ml[others], 1)
        off_ml = pulse_ml - slope * open_s - offset
        rest_ml2 = float(np.sum(off_ml[others] ** 2))
        if rest_ml2 < least_ml2:
            best, beside_ml, least_ml2 = k, float(off_ml[k]), rest_ml2
    return best, beside_ml


def _name(cup: Catch) -> str:
    return f"the cup of {cup.pulses} x {cup.open_s:.3f} s"

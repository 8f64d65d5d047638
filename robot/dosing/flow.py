"""Valve time to volume and back, and the fit of both to a catch test."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, slots=True)
class FlowModel:
    """Volume = Q(P) * max(0, t_on - t_open + t_close) with Q(P) = Q_ref * sqrt(P / P_ref) (turbulent orifice).

    ``flow_ml_s`` is Q_ref at ``pressure_bar``; ``open_latency_s`` passes between coil on and flow, ``close_latency_s``
    between coil off and its end.
    """

    flow_ml_s: float
    pressure_bar: float
    open_latency_s: float
    close_latency_s: float

    def __post_init__(self) -> None:
        if not (0.0 < self.flow_ml_s < math.inf and 0.0 < self.pressure_bar < math.inf):
            raise ValueError(f"a flow model needs positive flow and pressure, found {self}")
        if not (0.0 <= self.open_latency_s < 1.0 and 0.0 <= self.close_latency_s < 1.0):
            raise ValueError(f"valve latencies must lie in 0..1 s, found {self}")

    def flow_at(self, pressure_bar: float) -> float:
        """ml/s at a pressure; ``ValueError`` unless the pressure is positive."""
        if not 0.0 < pressure_bar < math.inf:
            raise ValueError(f"expected a positive pressure in bar, found {pressure_bar}")
        return self.flow_ml_s * math.sqrt(pressure_bar / self.pressure_bar)

    def volume_ml(self, open_s: float, pressure_bar: float) -> float:
        """What leaves the nozzle when the coil is on for ``open_s``; a coil that was never on gives nothing."""
        if open_s <= 0.0:
            return 0.0
        return self.flow_at(pressure_bar) * max(0.0, open_s - self.open_latency_s + self.close_latency_s)

    def open_s(self, volume_ml: float, pressure_bar: float) -> float:
        """Coil time that gives ``volume_ml``; 0 for 0 ml. May lie below what the valve can do: see ``plan``."""
        if volume_ml <= 0.0:
            return 0.0
        return max(0.0, volume_ml / self.flow_at(pressure_bar) + self.open_latency_s - self.close_latency_s)


@dataclass(frozen=True, slots=True)
class FlowFit:
    """A fitted model; ``residual_ml`` is caught less fitted, one a catch, ``rms_ml`` their root mean square.

    ``flow_sigma_ml_s`` and ``dead_time_sigma_s`` are one-sigma errors of slope and offset, from the residuals.
    """

    model: FlowModel
    dead_time_s: float
    residual_ml: tuple[float, ...]
    rms_ml: float
    flow_sigma_ml_s: float
    dead_time_sigma_s: float


def fit_flow(
    open_s: Sequence[float], ml: Sequence[float], pressure_bar: float, close_latency_s: float = 0.02
) -> FlowFit:
    """Least-squares line through a catch test: ml = Q * (open_s - dead time).

    A catch tells only the difference of the two latencies (the dead time); ``close_latency_s`` says how it is shared.
    ``ValueError`` for fewer than three catches, fewer than two pulse lengths, or a flow that does not rise with time.
    """
    time_s, caught_ml = np.asarray(open_s, dtype=np.float64), np.asarray(ml, dtype=np.float64)
    if time_s.ndim != 1 or time_s.shape != caught_ml.shape or len(time_s) < 3:
        raise ValueError(
            f"a catch test needs at least 3 pulses, each with its millilitres; found {len(open_s)} and {len(ml)}"
        )
    both = np.concatenate([time_s, caught_ml])
    if not np.all(np.isfinite(both) & (both > 0.0)):
        raise ValueError("every pulse length and every catch must be positive and finite; leave out empty catches")
    spread = float(np.sum((time_s - time_s.mean()) ** 2))
    if spread < 1e-6:
        raise ValueError("all pulses have the same length; catch at two lengths or more, e.g. 0.2, 0.5 and 1.0 s")
    slope = float(np.sum((time_s - time_s.mean()) * (caught_ml - caught_ml.mean())) / spread)
    if slope <= 0.0:
        raise ValueError("longer pulses did not give more; check the nozzle, the pressure and the order of the figures")
    dead_s = float(time_s.mean() - caught_ml.mean() / slope)
    residual_ml = caught_ml - slope * (time_s - dead_s)
    variance = float(np.sum(residual_ml**2)) / (len(time_s) - 2)
    latency_s = dead_s + close_latency_s
    model = FlowModel(slope, pressure_bar, max(0.0, latency_s), close_latency_s + max(0.0, -latency_s))
    return FlowFit(
        model=model,
        dead_time_s=dead_s,
        residual_ml=tuple(residual_ml.tolist()),
        rms_ml=float(np.sqrt(np.mean(residual_ml**2))),
        flow_sigma_ml_s=math.sqrt(variance / spread),
        dead_time_sigma_s=math.sqrt(variance / slope**2 * (1 / len(time_s) + (caught_ml.mean() / slope) ** 2 / spread)),
    )

"""Commanded against measured: what the flow meter says of nozzle, tank and pump, shot by shot."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

LEAST_RATIO, GREATEST_RATIO = 0.7, 1.3  # measured over expected, on one shot
OVER_SHOTS = 10
GREATEST_MISMATCH = 0.15  # of the sum over any ``OVER_SHOTS`` shots
DRY_RATIO = 0.5  # below it, with the pump on, air is drawn


@dataclass(frozen=True, slots=True)
class ShotFlow:
    """One whole shot: millilitres that the flow model expected, and that the meter counted."""

    model_ml: float
    measured_ml: float

    @property
    def ratio(self) -> float:
        return self.measured_ml / self.model_ml


@dataclass(frozen=True, slots=True)
class FlowHistory:
    """The newest ``OVER_SHOTS`` whole shots, oldest first. ``resolution_ml`` is one pulse of the meter."""

    resolution_ml: float
    shots: tuple[ShotFlow, ...] = ()

    def with_shot(self, model_ml: float, measured_ml: float) -> FlowHistory:
        """One more shot. ``ValueError`` unless something was expected of it."""
        if not model_ml > 0.0:
            raise ValueError(f"expected a shot of more than 0 ml, found {model_ml}")
        return replace(self, shots=(*self.shots, ShotFlow(model_ml, measured_ml))[-OVER_SHOTS:])

    @property
    def problem(self) -> str:
        """Why the nozzle must be checked before the next shot, "" when it need not."""
        return one_shot_problem(self.shots, self.resolution_ml) or many_shots_problem(self.shots, self.resolution_ml)

    @property
    def dry(self) -> bool:
        """The newest shot gave so little that the pump draws air, or nothing comes through."""
        if not self.shots:
            return False
        newest = self.shots[-1]
        return newest.measured_ml < DRY_RATIO * newest.model_ml - self.resolution_ml


def one_shot_problem(shots: Sequence[ShotFlow], resolution_ml: float) -> str:
    """Of the newest shot alone. One pulse of the meter is not held against it."""
    if not shots:
        return ""
    newest = shots[-1]
    if newest.measured_ml < LEAST_RATIO * newest.model_ml - resolution_ml:
        return f"flow meter saw {_figures(newest)}: check nozzle, filter and meter"
    if newest.measured_ml > GREATEST_RATIO * newest.model_ml + resolution_ml:
        return f"flow meter saw {_figures(newest)}: check nozzle (worn or gone), pressure and meter"
    return ""


def many_shots_problem(shots: Sequence[ShotFlow], resolution_ml: float) -> str:
    """Of the sum over the last ``OVER_SHOTS``, once there are so many."""
    if len(shots) < OVER_SHOTS:
        return ""
    recent = shots[-OVER_SHOTS:]
    total = ShotFlow(sum(shot.model_ml for shot in recent), sum(shot.measured_ml for shot in recent))
    if abs(total.measured_ml - total.model_ml) <= GREATEST_MISMATCH * total.model_ml + resolution_ml:
        return ""
    return f"over {OVER_SHOTS} shots the flow meter saw {_figures(total)}: check nozzle, then calibrate the flow"


def tank_problem(balance_ml: float, level_ml: float, reserve_ml: float) -> str:
    """Why the tank counts as empty, "" when it does not: by the ledger's balance, or by the level sensor."""
    if not balance_ml >= reserve_ml:
        return f"by the ledger the tank holds {balance_ml:.0f} ml (reserve {reserve_ml:.0f}): refill it"
    if not level_ml >= reserve_ml:
        return f"the tank's level reads {level_ml:.0f} ml (reserve {reserve_ml:.0f}): refill it"
    return ""


def _figures(shot: ShotFlow) -> str:
    return f"{shot.measured_ml:.2f} of {shot.model_ml:.2f} ml ({100 * shot.ratio:.0f} %)"

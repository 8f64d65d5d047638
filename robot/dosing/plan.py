"""A dose to valve openings."""

from __future__ import annotations

import math
from dataclasses import dataclass

from robot.dosing.flow import FlowModel
from robot.dosing.law import DoseLaw
from robot.dosing.values import Due, Refusal, Shot

_ROUNDING = 1e-9


@dataclass(frozen=True, slots=True)
class PulseLimits:
    """Shortest coil time that the valve repeats, and longest single opening."""

    min_s: float
    max_s: float

    def __post_init__(self) -> None:
        if not 0.0 < self.min_s < self.max_s < math.inf:
            raise ValueError(f"need 0 < min_s < max_s, found {self}")


@dataclass(frozen=True, slots=True)
class Caps:
    """Most that one shot may give, and what is left of every total (label, minute, tank): a name and ml each."""

    shot_ml: float = math.inf
    left_ml: tuple[tuple[str, float], ...] = ()


def plan(
    due: Due,
    law: DoseLaw,
    flow: FlowModel,
    pressure_bar: float,
    pulses: PulseLimits,
    caps: Caps,
) -> Shot | Refusal:
    """The dose that a fruit is due, inside minimum, maximum and caps, as equal pulses the valve can do.

    A cap on the shot shortens the dose and is named in ``limit``; a total with too little left refuses the whole dose,
    since half a dose is neither treated nor untreated.
    """
    if not 0.0 <= due.ml < math.inf:
        return Refusal(f"the dose that is due is no amount ({due.ml} ml)")
    if not 0.0 < pressure_bar < math.inf:
        return Refusal(f"no pressure at the nozzle ({pressure_bar} bar)")
    dose_ml, limit = due.ml, ""
    if dose_ml < law.min_ml:
        dose_ml, limit = law.min_ml, "minimum dose"
    if dose_ml > law.max_ml:
        dose_ml, limit = law.max_ml, "maximum dose"
    if dose_ml > caps.shot_ml:
        dose_ml, limit = caps.shot_ml, "cap of a shot"
    for name, left_ml in caps.left_ml:
        if not dose_ml <= left_ml:
            return Refusal(f"{name}: {max(0.0, left_ml):.1f} ml left, {dose_ml:.1f} ml due")
    open_s = _pulses(dose_ml, flow, pressure_bar, pulses)
    if not open_s:
        least_ml = flow.volume_ml(pulses.min_s, pressure_bar)
        return Refusal(
            f"{dose_ml:.2f} ml cannot be given: a pulse of {pulses.min_s:.3f} to {pulses.max_s:.3f} s "
            f"gives {least_ml:.2f} to {flow.volume_ml(pulses.max_s, pressure_bar):.2f} ml"
        )
    return Shot(
        due_ml=due.ml,
        dose_ml=dose_ml,
        open_s=open_s,
        limit="" if dose_ml == due.ml else limit,
        factor=due.factor,
        basis=due.basis,
    )


def _pulses(dose_ml: float, flow: FlowModel, pressure_bar: float, limits: PulseLimits) -> tuple[float, ...]:
    """Fewest equal openings that give the dose; none when even one is too short or the parts would be."""
    most_ml = flow.volume_ml(limits.max_s, pressure_bar)
    if most_ml <= 0.0 or dose_ml <= 0.0:
        return ()
    count = max(1, math.ceil(dose_ml / most_ml - _ROUNDING))
    each_s = flow.open_s(dose_ml / count, pressure_bar)
    if each_s < limits.min_s - _ROUNDING:
        return ()
    return (min(max(each_s, limits.min_s), limits.max_s),) * count

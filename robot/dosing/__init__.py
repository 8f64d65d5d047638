"""Fruit size to millilitres to valve openings."""

from robot.dosing.catch_test import Catch, CatchFit, fit_catches, meter_ml_per_pulse
from robot.dosing.flow import FlowFit, FlowModel, fit_flow
from robot.dosing.law import DoseLaw, LawKind
from robot.dosing.plan import Caps, PulseLimits, plan
from robot.dosing.values import Refusal, Shot

__all__ = [
    "Caps",
    "Catch",
    "CatchFit",
    "DoseLaw",
    "FlowFit",
    "FlowModel",
    "LawKind",
    "PulseLimits",
    "Refusal",
    "Shot",
    "fit_catches",
    "fit_flow",
    "meter_ml_per_pulse",
    "plan",
]

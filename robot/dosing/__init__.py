"""Fruit size and ripeness to millilitres to valve openings."""

from robot.dosing.catch_test import Catch, CatchFit, fit_catches, meter_ml_per_pulse
from robot.dosing.due import DoseRules, Hidden, due
from robot.dosing.factor import RipenessFactors
from robot.dosing.flow import FlowFit, FlowModel, fit_flow
from robot.dosing.flow_check import FlowHistory, ShotFlow, tank_problem
from robot.dosing.law import DoseLaw, LawKind
from robot.dosing.plan import Caps, PulseLimits, plan
from robot.dosing.values import Due, Refusal, Shot

__all__ = [
    "Caps",
    "Catch",
    "CatchFit",
    "DoseLaw",
    "DoseRules",
    "Due",
    "FlowFit",
    "FlowHistory",
    "FlowModel",
    "Hidden",
    "LawKind",
    "PulseLimits",
    "Refusal",
    "RipenessFactors",
    "Shot",
    "ShotFlow",
    "due",
    "fit_catches",
    "fit_flow",
    "meter_ml_per_pulse",
    "plan",
    "tank_problem",
]

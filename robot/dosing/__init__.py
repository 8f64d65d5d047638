"""Fruit size to millilitres to valve openings."""

from robot.dosing.flow import FlowFit, FlowModel, fit_flow
from robot.dosing.law import DoseLaw, LawKind
from robot.dosing.plan import Caps, PulseLimits, plan
from robot.dosing.values import Refusal, Shot

__all__ = ["Caps", "DoseLaw", "FlowFit", "FlowModel", "LawKind", "PulseLimits", "Refusal", "Shot", "fit_flow", "plan"]

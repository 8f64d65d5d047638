"""The machine in an operator's hands: a session in mode MANUAL, and what can be done in it."""

from robot.runtime.manual.building import ManualOptions
from robot.runtime.manual.session import ByHand, Stopped, manual

__all__ = ["ByHand", "ManualOptions", "Stopped", "manual"]

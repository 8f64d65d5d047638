"""The one place that holds handles which can move or spray."""

from robot.actuation.hands import Actuation
from robot.actuation.values import LEDGER_WRITE_S, HandSettings, PartStopped, PulseOrder, Refused

__all__ = ["LEDGER_WRITE_S", "Actuation", "HandSettings", "PartStopped", "PulseOrder", "Refused"]

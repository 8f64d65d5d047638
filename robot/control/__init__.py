"""One door for every face: the local API over a Unix socket."""

from robot.control.machine import (
    Declined,
    FaultNow,
    LatenessCounts,
    LedgerNow,
    Machine,
    MissionNow,
    Plan,
    PortCounts,
    Status,
    TaskChoice,
)
from robot.control.server import serve
from robot.control.socket_file import ControlSocket

__all__ = [
    "ControlSocket",
    "Declined",
    "FaultNow",
    "LatenessCounts",
    "LedgerNow",
    "Machine",
    "MissionNow",
    "Plan",
    "PortCounts",
    "Status",
    "TaskChoice",
    "serve",
]

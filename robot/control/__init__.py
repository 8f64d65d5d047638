"""One door for every face: the local API over a Unix socket."""

from robot.control.client import Answer, ask, find_socket
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
from robot.control.socket_file import ControlSocket, socket_path

__all__ = [
    "Answer",
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
    "ask",
    "find_socket",
    "serve",
    "socket_path",
]

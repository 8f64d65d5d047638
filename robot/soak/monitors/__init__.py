"""The properties that can be seen from outside, each held against the twin's truth while a robot lives."""

from robot.soak.monitors.account import Account
from robot.soak.monitors.base import ACTING, LATCHED, Bench, Court, Monitor
from robot.soak.monitors.liveness import Liveness
from robot.soak.monitors.motion import Motion
from robot.soak.monitors.openings import Openings
from robot.soak.monitors.permission import Leases, Permission

__all__ = [
    "ACTING",
    "LATCHED",
    "Account",
    "Bench",
    "Court",
    "Leases",
    "Liveness",
    "Monitor",
    "Motion",
    "Openings",
    "Permission",
]

"""The envelope that every actuator command passes: pure, default deny.

It claims no certified safety function: a hardware e-stop in the supply of valve, pump and drive is required.
"""

from robot.safety.arming import reasons_against_arming
from robot.safety.catalogue import CATALOGUE, Action, Clear, FaultKind
from robot.safety.envelope import authorise_motion, authorise_spray, settle_booking, still_allowed
from robot.safety.failsafe import fault_of, most_severe
from robot.safety.faults import clear_fault, report_fault
from robot.safety.latches import concerns, mode_line, taken_up
from robot.safety.lease import beat_lease, holder_reasons, release_lease, take_lease
from robot.safety.limits import Limits
from robot.safety.modes import LATCHED, MODE_CHANGES, Verb, change_mode
from robot.safety.monitor import watch
from robot.safety.values import (
    ActiveFault,
    Booking,
    Cell,
    Decision,
    Given,
    Inputs,
    Lease,
    Mode,
    MotionRequest,
    SafetyState,
    SprayRequest,
)

__all__ = [
    "CATALOGUE",
    "LATCHED",
    "MODE_CHANGES",
    "Action",
    "ActiveFault",
    "Booking",
    "Cell",
    "Clear",
    "Decision",
    "FaultKind",
    "Given",
    "Inputs",
    "Lease",
    "Limits",
    "Mode",
    "MotionRequest",
    "SafetyState",
    "SprayRequest",
    "Verb",
    "authorise_motion",
    "authorise_spray",
    "beat_lease",
    "change_mode",
    "clear_fault",
    "concerns",
    "fault_of",
    "holder_reasons",
    "mode_line",
    "most_severe",
    "reasons_against_arming",
    "release_lease",
    "report_fault",
    "settle_booking",
    "still_allowed",
    "take_lease",
    "taken_up",
    "watch",
]

"""The envelope that every actuator command passes: pure, default deny.

It claims no certified safety function: a hardware e-stop in the supply of valve, pump and drive is required.
"""

from robot.safety.arming import reasons_against_arming
from robot.safety.envelope import authorise_motion, authorise_spray, settle_booking, still_allowed
from robot.safety.limits import Limits
from robot.safety.modes import MODE_CHANGES, Verb, change_mode
from robot.safety.values import Booking, Decision, Inputs, Mode, MotionRequest, SafetyState, SprayRequest

__all__ = [
    "MODE_CHANGES",
    "Booking",
    "Decision",
    "Inputs",
    "Limits",
    "Mode",
    "MotionRequest",
    "SafetyState",
    "SprayRequest",
    "Verb",
    "authorise_motion",
    "authorise_spray",
    "change_mode",
    "reasons_against_arming",
    "settle_booking",
    "still_allowed",
]

"""What a row of the fault catalogue says."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum, StrEnum


class Action(IntEnum):
    """What a fault does, mildest first. The valve is closed first from INHIBIT_SPRAY on."""

    WARN = 0           # told and counted
    INHIBIT_SPRAY = 1  # no shot while it lasts; arm and base may move
    PAUSE = 2          # valve shut, arm held, base halted, until the cause is gone
    SAFE_STOP = 3      # latched: valve shut, pump off, base halted, arm held; an operator acknowledges
    ESTOP = 4          # latched: as SAFE_STOP; button released, reset, armed anew


class Clear(StrEnum):
    """What ends a fault."""

    GONE = "the cause is gone"
    ACKNOWLEDGED = "the cause is gone and an operator has acknowledged it"
    RESET = "the button is released, a reset, and arming anew"
    RESTARTED = "the cause is mended and the program started anew"
    PASSED = "nothing to clear: the one message, frame or request is dropped"


class Proof(StrEnum):
    """How it is shown that the machine does what the row says."""

    SIMULATED = "a test injects it into the simulated machine"
    CARD = "a test card, with water, on the machine"
    FACES = "comes with the operator's remote faces"


@dataclass(frozen=True, slots=True)
class FaultKind:
    """``within_s``: from the cause to the action, seconds. ``kept``: what must not be lost."""

    id: str
    title: str
    detected_by: str
    within_s: float
    action: Action
    clears: Clear
    kept: str
    proof: Proof = Proof.SIMULATED

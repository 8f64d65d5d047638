"""What a relay board takes and gives."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum

LONGEST_WATCHDOG_S = 5.0


class Channel(StrEnum):
    """Relay channels by what hangs on them; the configuration maps each to a number on the board."""

    VALVE = "valve"
    PUMP = "pump"
    LAMP = "lamp"
    CONTACTOR = "contactor"
    BEACON = "beacon"


@dataclass(frozen=True, slots=True)
class RelayState:
    """Coils as read back from the board at ``stamp_s`` (loop time)."""

    stamp_s: float
    coils: Mapping[Channel, bool]


@dataclass(frozen=True, slots=True)
class BoardCapability:
    """What the board can time by itself.

    ``pulse_quantum_s``: pulses are multiples of it. ``pulse_max_s``: the longest. ``pulse_max_s == 0`` means that
    no pulse is to be had. ``watchdog_s``: it switches everything off after this silence, None without one.
    ``host_timed``: the host ends the pulses, and the watchdog only if the host cannot.
    """

    pulse_quantum_s: float
    pulse_max_s: float
    watchdog_s: float | None
    host_timed: bool = False


@dataclass(frozen=True, slots=True)
class PulseReceipt:
    """The board's word that a pulse runs: accepted at ``accepted_s``, over by itself after ``duration_s``.

    ``sent_s`` is the moment before the command was written: the coil closed between the two stamps.
    """

    channel: Channel
    sent_s: float
    accepted_s: float
    duration_s: float


def refusal_for_automatic(capability: BoardCapability) -> str | None:
    """Why a board must not spray unattended, None when it may: somebody but the host must be able to end a pulse."""
    if capability.watchdog_s is not None and capability.host_timed and capability.watchdog_s > LONGEST_WATCHDOG_S:
        return (
            f"the relay board would shut the valve only {capability.watchdog_s:g} s after the host fell silent; "
            f"set its watchdog to {LONGEST_WATCHDOG_S:g} s or less"
        )
    timed = capability.pulse_max_s > 0.0 and not capability.host_timed
    if timed or (capability.host_timed and capability.watchdog_s is not None):
        return None
    return (
        "the relay board can neither time a pulse nor watch the line, so nothing would shut the valve "
        "if the host died; use a board that can, or spray by hand"
    )

"""What a relay board takes and gives."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum


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
    the board cannot time a pulse. ``watchdog_s``: it switches everything off after this silence, None without one.
    """

    pulse_quantum_s: float
    pulse_max_s: float
    watchdog_s: float | None


@dataclass(frozen=True, slots=True)
class PulseReceipt:
    """The board's word that a pulse runs: accepted at ``accepted_s``, over by itself after ``duration_s``.

    ``sent_s`` is the moment before the command was written: the coil closed between the two stamps.
    """

    channel: Channel
    sent_s: float
    accepted_s: float
    duration_s: float

"""Which relay board there is on a Modbus bus, and what hangs on it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from drivers.modbus_master import TIMEOUT_S
from drivers.relay.profiles import profile_named
from drivers.relay.values import Channel


@dataclass(frozen=True, slots=True)
class RelaySettings:
    """Which board, and what hangs on it. ``ValueError`` for what cannot be.

    ``channels``: the number, from 1 as printed on the board, of each. A pulse longer than ``lease_s`` is kept up by
    renewed ones, so that a dead host's coil opens within ``lease_s``. ``watchdog_s`` is for boards that watch the line.
    """

    profile: str
    unit_id: int
    channels: Mapping[Channel, int]
    lease_s: float = 1.0
    longest_pulse_s: float = 30.0
    watchdog_s: float = 1.0
    reply_timeout_s: float = TIMEOUT_S

    def __post_init__(self) -> None:
        profile = profile_named(self.profile)
        if not 1 <= self.unit_id <= 255:
            raise ValueError(f"unit_id: expected 1 to 255, found {self.unit_id}; correct it")
        numbers = list(self.channels.values())
        for channel, number in self.channels.items():
            if not 1 <= number <= profile.channels:
                raise ValueError(f"channels.{channel}: expected 1 to {profile.channels}, found {number}; correct it")
            if numbers.count(number) > 1:
                raise ValueError(f"channels.{channel}: expected a number of its own, found {number} twice; correct it")
        if not self.channels:
            raise ValueError("channels: expected at least one channel, found none; name what is wired")
        if profile.pulse is not None and not self.lease_s >= 2.0 * profile.pulse.quantum_s:
            raise ValueError(
                f"lease_s: expected {2.0 * profile.pulse.quantum_s:g} s or more with {profile.name}, whose timer goes "
                f"in steps of {profile.pulse.quantum_s:g} s, found {self.lease_s:g}; raise it"
            )
        if profile.watchdog is not None and not self.watchdog_s >= profile.watchdog.unit_s:
            raise ValueError(
                f"watchdog_s: expected {profile.watchdog.unit_s:g} s or more, found {self.watchdog_s:g}; raise it"
            )
        for name in ("longest_pulse_s", "reply_timeout_s"):
            if not 0.0 < getattr(self, name) < math.inf:
                raise ValueError(f"{name}: expected a positive number, found {getattr(self, name)}; correct it")

"""The relays of an emulated board: those that the machine's wiring uses are the twin's, the others the board's own."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from drivers.relay.values import Channel
from drivers.twin.bus import LATE_S
from drivers.twin.commands import RelayAllOff, RelayPulse, RelaySwitch
from drivers.twin.faults import Verb
from drivers.twin.machine import Twin


@dataclass(slots=True)
class _Spare:
    """A relay with nothing on it."""

    on: bool = False
    ends_s: float | None = None

    def settle(self, now_s: float) -> None:
        if self.ends_s is not None and self.ends_s <= now_s:
            self.on, self.ends_s = False, None


class Outputs:
    """``count`` relays, numbered from 1; ``wired`` says which of them the twin's channels are."""

    def __init__(self, twin: Twin, clock: Callable[[], float], count: int, wired: Mapping[Channel, int]) -> None:
        self.count = count
        self._twin, self._clock = twin, clock
        self._channels = {number: channel for channel, number in wired.items() if channel in twin.nominal.channels}
        self._spares = {number: _Spare() for number in range(1, count + 1) if number not in self._channels}

    def contacts(self) -> list[bool]:
        """What the board reads back, relay 1 first; WRONG shows the first channel the other way round."""
        now_s = self._clock()
        coils = self._twin.coils(now_s)
        if self._verb is Verb.WRONG:
            coils[min(coils)] ^= True
        for spare in self._spares.values():
            spare.settle(now_s)
        return [
            coils[self._channels[number]] if number in self._channels else self._spares[number].on
            for number in range(1, self.count + 1)
        ]

    def timed(self, number: int) -> bool:
        """Whether a pulse runs on the relay."""
        now_s = self._clock()
        if number in self._channels:
            self._twin.advance(now_s)
            return self._channels[number] in self._twin.physics.board.timers_s
        self._spares[number].settle(now_s)
        return self._spares[number].ends_s is not None

    def switch(self, number: int, on: bool) -> None:
        """On or off until further notice; a running pulse is over."""
        if number in self._channels:
            self._twin.apply(self._clock(), RelaySwitch(self._channels[number], on, self._arrival_s))
        else:
            self._spares[number].on, self._spares[number].ends_s = on, None

    def pulse(self, number: int, duration_s: float) -> None:
        """On for so long; 0 s is off."""
        if duration_s <= 0.0:
            self.switch(number, False)
        elif number in self._channels:
            self._twin.apply(self._clock(), RelayPulse(self._channels[number], duration_s, self._arrival_s))
        else:
            self._spares[number].on, self._spares[number].ends_s = True, self._clock() + duration_s

    def all_off(self) -> None:
        """Every relay off, every pulse over."""
        self._twin.apply(self._clock(), RelayAllOff(self._arrival_s))
        for spare in self._spares.values():
            spare.on, spare.ends_s = False, None

    @property
    def _verb(self) -> Verb:
        return self._twin.verb("relay", self._clock())

    @property
    def _arrival_s(self) -> float:
        """When a command that is through takes effect."""
        return self._clock() + (LATE_S if self._verb is Verb.DELAYED else 0.0)

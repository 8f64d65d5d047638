"""A relay board that times pulses by itself."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from drivers.relay.values import Channel
from drivers.twin.commands import RelayAllOff, RelayPulse, RelaySwitch

Frame = RelaySwitch | RelayPulse | RelayAllOff


@dataclass(frozen=True, slots=True)
class CoilChange:
    at_s: float
    channel: Channel
    on: bool


class Board:
    """Coils and their timers. Frames take effect in order of arrival; at power-on every coil is off.

    While ``frozen`` the contacts stay where they are (welded or without drive), though frames are acknowledged.
    """

    def __init__(self, channels: Iterable[Channel]) -> None:
        self._wanted = dict.fromkeys(sorted(channels), False)
        self._contact = dict(self._wanted)
        self._ends_s: dict[Channel, float] = {}
        self._frames: list[tuple[float, Frame]] = []
        self.frozen = False

    @property
    def contacts(self) -> Mapping[Channel, bool]:
        """Where each contact is, which is what the board reads back."""
        return self._contact

    def submit(self, arrives_s: float, frame: Frame) -> None:
        """A frame is on the wire and reaches the board at ``arrives_s``, but never before an earlier one."""
        if self._frames:
            arrives_s = max(arrives_s, self._frames[-1][0])
        self._frames.append((arrives_s, frame))

    @property
    def next_s(self) -> float:
        """When something next happens on the board, infinity when nothing will."""
        frame_s = self._frames[0][0] if self._frames else math.inf
        return min(frame_s, *self._ends_s.values(), math.inf)

    @property
    def timers_s(self) -> Mapping[Channel, float]:
        """When each running pulse ends."""
        return self._ends_s

    def step(self, t_s: float) -> list[CoilChange]:
        """Do what is due at ``t_s``; a frame that arrives as a timer runs out goes first."""
        while self._frames and self._frames[0][0] <= t_s:
            self._obey(self._frames.pop(0)[1], t_s)
        for channel in [channel for channel, end_s in self._ends_s.items() if end_s <= t_s]:
            del self._ends_s[channel]
            self._wanted[channel] = False
        if self.frozen:
            return []
        changes = [CoilChange(t_s, ch, on) for ch, on in self._wanted.items() if self._contact[ch] != on]
        self._contact.update(self._wanted)
        return changes

    def _obey(self, frame: Frame, t_s: float) -> None:
        if isinstance(frame, RelayAllOff):
            self._ends_s.clear()
            self._wanted.update(dict.fromkeys(self._wanted, False))
            return
        self._ends_s.pop(frame.channel, None)
        if isinstance(frame, RelayPulse):
            self._wanted[frame.channel] = True
            self._ends_s[frame.channel] = t_s + frame.duration_s
        else:
            self._wanted[frame.channel] = frame.on

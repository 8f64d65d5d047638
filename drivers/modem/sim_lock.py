"""The lock of a SIM: asked for its state, given its PIN once, and never a PIN that was refused (27.007, 8.3)."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

from drivers.errors import DeviceFault
from drivers.line import Line
from drivers.modem import at_words
from drivers.modem.at_channel import DEVICE, AtChannel, AtRefused
from drivers.modem.at_figures import figures_of

READY = "READY"
FULL_TRIES = 3
BUSY_LOOK_S = 0.2
_PIN_ASKED, _PUK_ASKED = "SIM PIN", "SIM PUK"
_NOT_AGAIN = "correct modem.pin and unlock the SIM once in a phone; it is not tried again here, lest the SIM be barred"
_REMEDIES = {
    at_words.SIM_ABSENT: "put a SIM in, its contacts to the reader",
    at_words.SIM_BUSY: "wait half a minute and start again",
}


@dataclass(slots=True)
class SimMemory:
    """What is remembered of a SIM while its driver lives: whether a PIN was given that it has not accepted."""

    pin_is_spent: bool = False


class SimLock:
    """Made for one job in the owner's thread. ``within`` shortens a time-out to what is left for opening."""

    def __init__(
        self, line: Line, channel: AtChannel, memory: SimMemory, pin: str | None, within: Callable[[float], float]
    ) -> None:
        self._line, self._channel, self._memory, self._pin, self._within = line, channel, memory, pin, within

    def state(self, timeout_s: float, patience_s: float = 0.0) -> str:
        """As ``+CPIN`` tells it. ``AtRefused`` without a SIM; one that is busy is asked again for ``patience_s``."""
        deadline_s = time.monotonic() + patience_s
        while True:
            try:
                state = self._channel.ask_one(self._line, "AT+CPIN?", "+CPIN", self._within(timeout_s))
            except AtRefused as refused:
                if refused.code != at_words.SIM_BUSY or time.monotonic() + BUSY_LOOK_S > deadline_s:
                    raise
                self._channel.overhear(self._line.read_some(BUSY_LOOK_S))
            else:
                if state == READY:
                    self._memory.pin_is_spent = False
                return state

    def open(self, state: str, timeout_s: float) -> None:
        """Give the PIN if it is asked for. ``DeviceFault`` names what the SIM asks for and the attempts left."""
        if state == READY:
            return
        if state == _PIN_ASKED:
            self._give_pin(timeout_s)
        elif state == _PUK_ASKED:
            raise _locked(
                f"asks for its PUK ({_told(self._tries_left(_PUK_ASKED))})",
                "put it into a phone, give the PUK of its card and a new PIN, and set modem.pin to that",
            )
        else:
            raise _locked(f"asks for {state[:40]}", "unlock it in a phone, or ask its operator")

    def _give_pin(self, timeout_s: float) -> None:
        left = self._tries_left(_PIN_ASKED)
        if self._pin is None:
            raise _locked(f"asks for its PIN ({_told(left)})", "set modem.pin, or turn the PIN off in a phone")
        if self._memory.pin_is_spent or (left is not None and left < FULL_TRIES):
            raise _locked(f"has refused a PIN before ({_told(left)})", _NOT_AGAIN)
        self._memory.pin_is_spent = True
        try:
            self._channel.ask(self._line, f'AT+CPIN="{self._pin}"', None, self._within(timeout_s))
        except AtRefused as refused:
            found = f"refused its PIN: {refused.found} ({_told(self._tries_left(_PIN_ASKED))})"
            raise _locked(found, _NOT_AGAIN) from refused
        self._memory.pin_is_spent = False

    def _tries_left(self, asked: str) -> int | None:
        """By 27.007, 8.65, or SIMCom's own command; None when the modem tells neither."""
        try:
            for line in self._channel.ask(self._line, f'AT+CPINR="{asked}"', "+CPINR", self._within(1.0)):
                name, _, rest = line.partition(":")[2].partition(",")
                if name.strip(' "') == asked:
                    return figures_of(rest, 1)[0]
        except AtRefused:
            pass
        try:
            pin, puk = figures_of(self._channel.ask_one(self._line, "AT+SPIC", "+SPIC", self._within(1.0)), 2)
        except AtRefused:
            return None
        return pin if asked == _PIN_ASKED else puk


def without_sim(refused: AtRefused) -> DeviceFault:
    """The SIM's state could not even be asked for."""
    remedy = _REMEDIES.get(refused.code or 0, "take the SIM out and put it in again, or try another")
    return DeviceFault(DEVICE, "a SIM that is ready", refused.found, remedy)


def _locked(found: str, remedy: str) -> DeviceFault:
    return DeviceFault(DEVICE, "a SIM that is ready", f"the SIM locked: it {found}", remedy)


def _told(left: int | None) -> str:
    return "attempts left: not known" if left is None else f"attempts left: {left}"

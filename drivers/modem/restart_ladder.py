"""What is done to a modem that stays without a network or does not answer, the harder the longer it lasts."""

from __future__ import annotations

from enum import Enum


class Rung(Enum):
    """SET_UP: everything is told to it again. RESET: it restarts itself. POWER: its supply is switched off and on."""

    SET_UP = "set_up"
    RESET = "reset"
    POWER = "power"


LADDER = ((60.0, Rung.SET_UP), (300.0, Rung.RESET), (900.0, Rung.POWER))


class RestartLadder:
    """Begins again with the first trouble after a time of health, and after its last rung."""

    def __init__(self) -> None:
        self._since_s: float | None = None
        self._climbed = 0

    def due(self, now_s: float, healthy: bool) -> Rung | None:
        """The next rung if its time has come; each comes once in the course of one trouble."""
        if healthy:
            self._since_s, self._climbed = None, 0
            return None
        if self._since_s is None:
            self._since_s = now_s
        after_s, rung = LADDER[self._climbed]
        if now_s - self._since_s < after_s:
            return None
        self._climbed += 1
        if self._climbed == len(LADDER):
            self._since_s, self._climbed = now_s, 0
        return rung

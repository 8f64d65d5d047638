"""Speeds between the whole revolutions a minute that a motor controller takes."""

from __future__ import annotations

import math


class RpmSteps:
    """Chooses whole rpm of one wheel so that the wheel turns as far as the wanted speed would turn it.

    The step below or above the wanted speed is commanded, whichever leaves the wheel owing less when the next command
    comes as soon as this one did. The debt stays below what one rpm turns between two commands; a wanted 0 is 0 at once
    and forgives it. ``longest_s`` is how long a command holds at most (the controller's time-out).
    """

    def __init__(self, longest_s: float) -> None:
        self._longest_s = longest_s
        self.reset()

    def reset(self) -> None:
        """The wheel stands, or nothing is known of it."""
        self._wanted, self._commanded, self._at_s = 0.0, 0, math.nan
        self.debt_rpm_s = 0.0

    def next(self, wanted_rpm: float, now_s: float) -> int:
        """What to command at ``now_s``."""
        if wanted_rpm == 0.0:
            self.reset()
            return 0
        owed_rpm = 0.0
        if now_s > self._at_s:
            held_s = min(now_s - self._at_s, self._longest_s)
            self.debt_rpm_s += (self._wanted - self._commanded) * held_s
            owed_rpm = self.debt_rpm_s / held_s
        below = math.floor(wanted_rpm)
        between = wanted_rpm - below
        step = below + (between > 0.0 and between + owed_rpm >= 0.5)
        self._wanted, self._commanded, self._at_s = wanted_rpm, step, now_s
        return step

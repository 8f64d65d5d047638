"""Speeds between the whole revolutions a minute that a motor controller takes."""

from __future__ import annotations

import math


class RpmSteps:
    """Chooses whole rpm of one wheel so that the wheel turns as far as the wanted speed would turn it.

    The step below or above the wanted speed is commanded, whichever makes up for what the wheel owes. The debt never
    exceeds what one rpm turns between two commands; a wanted 0 is 0 at once and forgives it. ``longest_s`` is how long
    a command holds at most (the controller's time-out).
    """

    def __init__(self, longest_s: float) -> None:
        self._longest_s = longest_s
        self._wanted = 0.0
        self._commanded = 0
        self._at_s: float | None = None
        self.debt_rpm_s = 0.0

    def reset(self) -> None:
        """The wheel stands, or nothing is known of it."""
        self._wanted, self._commanded, self._at_s, self.debt_rpm_s = 0.0, 0, None, 0.0

    def next(self, wanted_rpm: float, now_s: float) -> int:
        """What to command at ``now_s``."""
        if wanted_rpm == 0.0:
            self.reset()
            return 0
        if self._at_s is not None:
            held_s = min(max(0.0, now_s - self._at_s), self._longest_s)
            self.debt_rpm_s += (self._wanted - self._commanded) * held_s
        below = math.floor(wanted_rpm)
        if wanted_rpm == below:
            step = below
        elif self.debt_rpm_s == 0.0:
            step = round(wanted_rpm)
        else:
            step = below + (self.debt_rpm_s > 0.0)
        self._wanted, self._commanded, self._at_s = wanted_rpm, step, now_s
        return step

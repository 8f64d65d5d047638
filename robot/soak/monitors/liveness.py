"""The machine goes on, and nothing dies unheard."""

from __future__ import annotations

from robot.safety import Mode
from robot.soak.monitors.base import ACTING, Court, Monitor
from robot.soak.values import Line

LONGEST_SILENCE_S = 120.0


class Liveness(Monitor):
    """"alive": in AUTO something is commanded or looked at at least every two minutes; a program that neither works nor
    stops has hung. ("tasks": the soak reports exceptions that no task took, and errors that are no ``SprayerError``.)
    """

    names = ("alive", "tasks")

    def __init__(self, court: Court) -> None:
        super().__init__(court)
        self._last_s = 0.0

    def begin(self) -> None:
        self._last_s = self.court.t_s

    def mode(self, before: Mode, after: Mode) -> None:
        self._last_s = self.court.t_s

    def line(self, line: Line) -> None:
        if line.kind not in ("command", "view") or line.what.startswith("world"):
            return
        silent_s, self._last_s = line.t_s - self._last_s, line.t_s
        if self.court.mode in ACTING and silent_s > LONGEST_SILENCE_S:
            self.court.report("alive", f"nothing was done for {silent_s:.0f} s in mode {self.court.mode}")

    def end(self) -> None:
        silent_s = self.court.t_s - self._last_s
        if self.court.mode in ACTING and self.court.killed_s is None and silent_s > LONGEST_SILENCE_S:
            self.court.report("alive", f"nothing was done for {silent_s:.0f} s in mode {self.court.mode}")

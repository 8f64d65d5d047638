"""What every monitor shares: the court it stands before, and how it hears of things."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import ClassVar

from robot.safety import Mode
from robot.soak.ledger_view import LedgerView, ResultSeen
from robot.soak.machine_truth import MachineTruth
from robot.soak.values import Line, Rules, Violation

KEPT_LINES = 40
ACTING = (Mode.AUTO, Mode.MANUAL)
LATCHED = (Mode.SAFE_STOP, Mode.ESTOP)


@dataclass(slots=True, eq=False)
class Court:
    """What all monitors may look at, and where they report.

    ``mode`` is what the robot says of itself, DISARMED where a life begins; ``left_s`` when it last left AUTO or
    MANUAL, ``latched_s`` when it last was stopped, ``killed_s`` when the process was killed; None before.
    ``clean`` is a life in which nothing was done to the machine, nor in the one before; ``resume_asked`` whether a
    person asked for the resume that may come.
    """

    truth: MachineTruth
    rules: Rules
    ledger: LedgerView = field(default_factory=LedgerView)
    t_s: float = 0.0
    life: int = 0
    mode: Mode = Mode.DISARMED
    clean: bool = True
    resume_asked: bool = False
    left_s: float | None = None
    latched_s: float | None = None
    killed_s: float | None = None
    recent: deque[str] = field(default_factory=lambda: deque(maxlen=KEPT_LINES))
    violations: dict[str, Violation] = field(default_factory=dict)
    broken: dict[str, int] = field(default_factory=dict)

    def report(self, prop: str, text: str) -> None:
        """``prop`` does not hold; its first counter-example is kept whole, later ones are counted."""
        self.broken[prop] = self.broken.get(prop, 0) + 1
        if prop not in self.violations:
            self.violations[prop] = Violation(prop, self.t_s, self.life, text, tuple(self.recent))


class Monitor:
    """Watches some properties. ``names`` are theirs; the class's docstring says what is observed of each, and how."""

    names: ClassVar[tuple[str, ...]]

    def __init__(self, court: Court) -> None:
        self.court = court

    def begin(self) -> None:
        """A life begins."""

    def line(self, line: Line) -> None:
        """Something happens at the machine."""

    def mode(self, before: Mode, after: Mode) -> None:
        """The robot says that its mode has changed; ``court.mode`` is ``after`` already."""

    def booked(self, result: ResultSeen) -> None:
        """An outcome has been committed."""

    def killed(self) -> None:
        """The process is killed at this moment."""

    def end(self) -> None:
        """A life is over, the robot's program has gone, and the machine may have run on."""


class Bench:
    """The monitors together: each hears everything."""

    def __init__(self, court: Court, monitors: Sequence[Monitor]) -> None:
        self.court, self.monitors = court, tuple(monitors)

    @property
    def names(self) -> tuple[str, ...]:
        names = {name for monitor in self.monitors for name in monitor.names}
        return tuple(sorted(names, key=lambda name: (len(name), name)))

    def begin(self) -> None:
        court = self.court
        court.life += 1
        court.mode = Mode.DISARMED
        court.left_s = court.latched_s = court.killed_s = None
        for monitor in self.monitors:
            monitor.begin()

    def line(self, line: Line) -> None:
        court = self.court
        court.t_s = max(court.t_s, line.t_s)
        if line.kind != "state" and line.what != "arm goal":
            self._remember(line)
        if line.what == "relay pulse":
            self.look_at_ledger()
        for monitor in self.monitors:
            monitor.line(line)

    def _remember(self, line: Line) -> None:
        """Of commands to drive only the last of each series."""
        recent = self.court.recent
        if recent and line.what == "wheels drive" and line.what in recent[-1]:
            recent.pop()
        recent.append(str(line))

    def mode_changed(self, after: Mode, causes: Sequence[str], t_s: float) -> None:
        court = self.court
        court.t_s = max(court.t_s, t_s)
        court.recent.append(f"{t_s:.3f} s  mode {after} {'; '.join(causes)}")
        before, court.mode = court.mode, after
        if before in ACTING and after not in ACTING:
            court.left_s = t_s
        if after in LATCHED and before not in LATCHED:
            court.latched_s = t_s
        for monitor in self.monitors:
            monitor.mode(before, after)

    def killed(self, t_s: float) -> None:
        self.court.t_s = self.court.killed_s = t_s
        self.court.recent.append(f"{t_s:.3f} s  the process is killed")
        for monitor in self.monitors:
            monitor.killed()

    def end(self) -> None:
        self.look_at_ledger()
        for monitor in self.monitors:
            monitor.end()

    def look_at_ledger(self) -> None:
        for result in self.court.ledger.refresh():
            for monitor in self.monitors:
                monitor.booked(result)

"""Every opening of the valve: written down before, never longer than its pulse, shut in time."""

from __future__ import annotations

from drivers.relay.values import Channel
from drivers.twin.faults import Verb
from robot.safety import Mode
from robot.safety.timing import CLOSE_DEADLINE_S, PULSE_HARD_MAX_S
from robot.soak.ledger_view import IntentSeen, ResultSeen
from robot.soak.monitors.base import LATCHED, Court, Monitor
from robot.soak.values import Line

SLACK_S = 0.005
LATE_S = 0.35          # a relay line that is slow or delayed holds its frames up by as much
NOT_WELDED = frozenset(Verb) - {Verb.STUCK}  # what leaves the contacts to obey their frames and timers


def is_valve_pulse(line: Line) -> bool:
    return line.what == "relay pulse" and line.detail["channel"] == Channel.VALVE.value


class Openings(Monitor):
    """P1: as the frame that opens the valve is sent, exactly one intent without an outcome stands on disk (read there,
    beside the robot), and the frame's pulse is no longer than the intent's.

    P2: from ``coil_on`` to ``coil_off`` no longer than min(1.2 x the commanded opening + 100 ms, the longest pulse),
    whatever became of the host; and it is never switched on without a timer. Not of a board whose contacts are stuck.

    P3: an opening that a stop interrupts, or that nobody waits for any more, is over within the close deadline
    (``worst_stop_s`` is the worst) where the relay line is sound, else within the board's pulse; after a life the valve
    is shut. Not of a valve that is stuck or slow itself, nor of stuck contacts.

    P10: each intent has at most one opening; no intent row is lost or doubled by a restart.

    P22: the coil of a shot that is booked as whole was on for as long as was commanded (2 % and 50 ms), whatever the
    wall clock did meanwhile; where the relay line was sound.
    """

    names = ("P1", "P2", "P3", "P10", "P22")

    def __init__(self, court: Court) -> None:
        super().__init__(court)
        self.worst_stop_s = 0.0
        self.openings = 0
        self._intent: IntentSeen | None = None
        self._on_s: float | None = None
        self._lasted_s = 0.0
        self._opened: set[int] = set()
        self._stop_s: float | None = None
        self._board_sound = True

    def begin(self) -> None:
        court = self.court
        if court.ledger.rows != court.ledger.intents:
            court.report("P10", f"the ledger holds {court.ledger.rows} intents, {court.ledger.intents} were seen")
        self._stop_s = None

    def line(self, line: Line) -> None:
        if is_valve_pulse(line):
            self._ordered(line)
        elif line.what == "relay switch" and line.detail["on"] and line.detail["channel"] == Channel.VALVE.value:
            self.court.report("P2", "the valve was switched on for good: no timer of the board ends that")
        elif line.what == "coil_on" and line.detail["channel"] == Channel.VALVE.value:
            self._on_s = line.t_s
            self._board_sound = self.court.truth.sound("relay", 5.0)
        elif line.what == "coil_off" and line.detail["channel"] == Channel.VALVE.value:
            self._off(line.t_s)
        elif line.what == "valve_closed":
            self._shut(line.t_s)

    def mode(self, before: Mode, after: Mode) -> None:
        if after in LATCHED and before not in LATCHED:
            self.must_shut()

    def must_shut(self) -> None:
        """From this moment on the valve has no reason to be open."""
        truth = self.court.truth
        if self._stop_s is None and (truth.valve_open or truth.coil(Channel.VALVE)):
            self._stop_s = self.court.t_s

    def booked(self, result: ResultSeen) -> None:
        self._opened.discard(result.intent.id)
        lasted_s, wanted_s = self._lasted_s, result.intent.open_s
        if self._intent is None or result.intent.id != self._intent.id or result.outcome != "sprayed":
            return
        sound = self._board_sound and self.court.truth.sound("relay", 5.0)
        if sound and abs(lasted_s - wanted_s) > 0.02 * wanted_s + 0.05:
            self.court.report("P22", f"booked as a whole {wanted_s:.3f} s, the coil was on for {lasted_s:.3f} s")

    def end(self) -> None:
        truth = self.court.truth
        if truth.valve_open and truth.sound("relay") and truth.sound("valve"):
            self.court.report("P3", "the robot's life is over and the valve is open")

    def _ordered(self, line: Line) -> None:
        court, pulse_s = self.court, float(line.detail["duration_s"])
        waiting = tuple(court.ledger.open.values())
        if len(waiting) != 1:
            court.report("P1", f"the valve was told to open with {len(waiting)} open intents on disk, expected 1")
            return
        self._intent = waiting[0]
        self.openings += 1
        if pulse_s > self._intent.pulse_s + SLACK_S:
            court.report("P1", f"a pulse of {pulse_s:.2f} s, the intent says {self._intent.pulse_s:.2f} s")
        if self._intent.id in self._opened:
            court.report("P10", f"intent {self._intent.id} opened the valve twice")
        self._opened.add(self._intent.id)

    def _off(self, t_s: float) -> None:
        if self._on_s is None:
            return
        self._lasted_s, self._on_s = t_s - self._on_s, None
        if not self.court.truth.sound("relay", self._lasted_s, but=NOT_WELDED):
            return
        ordered_s = self._intent.open_s if self._intent else 0.0
        most_s = min(1.2 * ordered_s + 0.1, self.court.rules.max_pulse_s + 0.1, PULSE_HARD_MAX_S) + SLACK_S
        if self._lasted_s > most_s:
            self.court.report(
                "P2", f"the valve's coil was on for {self._lasted_s:.3f} s, {ordered_s:.3f} s were commanded "
                f"(at most {most_s:.3f} s)"
            )  # fmt: skip

    def _shut(self, t_s: float) -> None:
        if self._stop_s is None:
            return
        took_s, self._stop_s = t_s - self._stop_s, None
        truth, rules = self.court.truth, self.court.rules
        if not truth.sound("valve", 10.0) or not truth.sound("relay", 10.0, but=NOT_WELDED):
            return
        board_s = (self._intent.pulse_s if self._intent else rules.max_pulse_s) + LATE_S
        if truth.sound("relay", took_s + 1.0):
            self.worst_stop_s = max(self.worst_stop_s, took_s)
            board_s = CLOSE_DEADLINE_S
        if took_s > board_s + rules.valve_close_s + SLACK_S:
            self.court.report("P3", f"the valve shut {took_s:.3f} s after the stop (at most {board_s:.3f} s)")

"""Millilitres: what is booked against what truly left the nozzle, and the caps on both."""

from __future__ import annotations

from collections import deque

from robot.soak.ledger_view import IntentSeen, ResultSeen
from robot.soak.monitors.base import Court, Monitor
from robot.soak.monitors.openings import NOT_WELDED, is_valve_pulse
from robot.soak.values import Line

EPSILON_ML = 0.05
FAULTLESS_SHARE = 0.05
FAULTLESS_FROM_ML = 60.0
MINUTE_S = 60.0


class Account(Monitor):
    """P9: whenever no shot is under way, what the ledger books since the row began is no less than what truly left the
    nozzle, and after a life without faults of some length no more than 5 % above it. What passed a valve or a relay
    contact that did not obey its coil is left out.

    P11: as a shot is authorised, what stands on disk plus its full pulse is within the caps of shot, target, rolling
    minute and task, over restarts; and so is what truly left the nozzle.
    """

    names = ("P9", "P11")

    def __init__(self, court: Court) -> None:
        super().__init__(court)
        self.true_ml = 0.0  # of the rows before this one
        self.disobeyed_ml = 0.0
        self._row_booked_ml = self._row_true_ml = 0.0
        self._life_booked_ml = self._life_true_ml = 0.0
        self._task: int | None = None
        self._target_ml: dict[int, float] = {}
        self._task_ml = 0.0
        self._minute: deque[tuple[float, float]] = deque()
        self._true_minute: deque[tuple[float, float]] = deque()
        self._true_target_ml: dict[int, float] = {}
        self._intent: IntentSeen | None = None
        self._sound_at_opening = True
        self._owed: frozenset[int] = frozenset()
        self._row_disobeyed_ml = 0.0

    def new_row(self) -> None:
        """Another machine stands before another row; the ledger goes on."""
        self.true_ml += self._row_true_ml
        self.disobeyed_ml += self._row_disobeyed_ml + self.court.truth.leaked_ml
        self._row_true_ml = self._row_disobeyed_ml = 0.0
        self._row_booked_ml = self.court.ledger.booked_ml
        self._task = self._intent = None
        self._true_target_ml.clear()

    def begin(self) -> None:
        self._life_booked_ml, self._life_true_ml = self.court.ledger.booked_ml, self._obeyed_ml()
        self._owed = frozenset(self.court.ledger.open)  # shots of the life before, which was killed in them

    def line(self, line: Line) -> None:
        if is_valve_pulse(line):
            self._compare("as the next shot is fired")
            self._authorised(line.t_s)
        elif line.what == "valve_opened":
            self._sound_at_opening = self._valve_obeys()
        elif line.what == "delivered":
            self._delivered(line)

    def booked(self, result: ResultSeen) -> None:
        intent = result.intent
        if intent.task_id != self._task:
            self._task, self._task_ml = intent.task_id, 0.0
            self._target_ml.clear()
        self._task_ml += result.booked_ml
        self._target_ml[intent.target_id] = self._target_ml.get(intent.target_id, 0.0) + result.booked_ml
        self._minute.append((self.court.t_s, result.booked_ml))

    def end(self) -> None:
        if self.court.truth.valve_open:
            return
        self._compare("after the life")
        booked_ml = self.court.ledger.booked_ml - self._life_booked_ml
        true_ml = self._obeyed_ml() - self._life_true_ml
        exact = self.court.clean and not self._owed
        if exact and true_ml > FAULTLESS_FROM_ML and booked_ml > (1.0 + FAULTLESS_SHARE) * true_ml:
            self.court.report("P9", f"a life without faults booked {booked_ml:.2f} ml, {true_ml:.2f} ml were sprayed")

    @property
    def all_true_ml(self) -> float:
        return self.true_ml + self._row_true_ml

    @property
    def all_disobeyed_ml(self) -> float:
        """Past a valve or a contact that did not obey: leaks, and openings under such a fault."""
        return self.disobeyed_ml + self._row_disobeyed_ml + self.court.truth.leaked_ml

    def _obeyed_ml(self) -> float:
        """Of this row, without what a broken valve let through."""
        truth = self.court.truth
        self._row_true_ml = truth.dispensed_ml
        return truth.dispensed_ml - truth.leaked_ml - self._row_disobeyed_ml

    def _compare(self, when: str) -> None:
        ledger = self.court.ledger
        booked_ml = ledger.booked_ml - self._row_booked_ml
        pending_ml = sum(
            intent.full_ml for intent in ledger.open.values()
            if self.court.killed_s is not None or intent.id in self._owed  # a life that cannot come up books nothing
        )  # fmt: skip
        true_ml = self._obeyed_ml()
        if booked_ml + pending_ml < true_ml - EPSILON_ML:
            self.court.report("P9", f"{when} {booked_ml:.2f} ml are booked, {true_ml:.2f} ml left the nozzle")

    def _valve_obeys(self) -> bool:
        truth = self.court.truth
        return truth.sound("valve", 15.0) and truth.sound("relay", 15.0, but=NOT_WELDED)

    def _authorised(self, t_s: float) -> None:
        court, rules = self.court, self.court.rules
        intent = self._intent = next(iter(court.ledger.open.values()), None)
        if intent is None:
            return
        same = intent.task_id == self._task
        task_ml = self._task_ml if same else 0.0
        target_ml = self._target_ml.get(intent.target_id, 0.0) if same else 0.0
        while self._minute and t_s - self._minute[0][0] >= MINUTE_S:
            self._minute.popleft()
        minute_ml = sum(ml for _, ml in self._minute)
        caps = (
            ("pulse", intent.pulse_s, rules.max_pulse_s, "s"),
            ("shot", intent.dose_ml, rules.max_shot_ml, "ml"),
            ("target", target_ml + intent.full_ml, rules.max_target_ml, "ml"),
            ("rolling minute", minute_ml + intent.full_ml, rules.max_minute_ml, "ml"),
            ("task", task_ml + intent.full_ml, rules.max_task_ml, "ml"),
        )
        for name, value, cap, unit in caps:
            if value > cap + 1e-6:
                court.report("P11", f"{name}: {value:.2f} {unit} were authorised, the cap is {cap:.2f} {unit}")

    def _delivered(self, line: Line) -> None:
        ml, rules, court = float(line.detail["ml"]), self.court.rules, self.court
        if not (self._sound_at_opening and self._valve_obeys()):
            self._row_disobeyed_ml += ml
            return
        self._true_minute.append((line.t_s, ml))
        while line.t_s - self._true_minute[0][0] >= MINUTE_S:
            self._true_minute.popleft()
        minute_ml = sum(amount for _, amount in self._true_minute)
        if minute_ml > rules.max_minute_ml + EPSILON_ML:
            court.report("P11", f"{minute_ml:.2f} ml left the nozzle in a minute, the cap is {rules.max_minute_ml:.2f}")
        if self._intent is None:
            return
        target = self._intent.target_id
        given_ml = self._true_target_ml[target] = self._true_target_ml.get(target, 0.0) + ml
        if given_ml > rules.max_target_ml + EPSILON_ML:
            court.report("P11", f"target {target} got {given_ml:.2f} ml, the cap is {rules.max_target_ml:.2f}")

"""Days of the robot's work in minutes: row after row, with all that goes wrong, under the eyes of the monitors."""

from __future__ import annotations

import gc
import shutil
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from drivers.twin.truth import TruthLog
from robot.errors import FileError
from robot.runtime import ledger_path
from robot.soak.composition import RowGrower, rules_of
from robot.soak.life import Life, LifeEnd, WallClock
from robot.soak.machine_truth import MachineTruth
from robot.soak.memory import MemoryCurve
from robot.soak.misfortunes import Misfortunes, draw
from robot.soak.monitors import Account, Bench, Court, Leases, Liveness, Motion, Openings, Permission
from robot.soak.operator import Operator
from robot.soak.oracle import Errors, TruthReader
from robot.soak.values import Violation
from robot.soak.watch import Watch

HOUR_S = 3600.0
LEDGER_H = 24.0      # then a new one is begun, as one would for a new day
REST_STEP_S = 0.5
LONGEST_REST_S = 60.0


@dataclass(frozen=True, slots=True)
class SoakOptions:
    """``folder`` holds the ledgers; ``truth`` a file for the twin's truth (None: it is judged and forgotten)."""

    hours: float
    seed: int
    folder: Path
    truth: Path | None = None


@dataclass(slots=True, eq=False)
class Tally:
    """What has been so far. ``running_s`` is the part of ``simulated_s`` in which the robot's program was up."""

    simulated_s: float = 0.0
    running_s: float = 0.0
    real_s: float = 0.0
    shots: int = 0
    rows_done: int = 0
    rows_left: int = 0
    lives: int = 0
    happened: Counter[str] = field(default_factory=Counter)
    endings: Counter[str] = field(default_factory=Counter)


@dataclass(frozen=True, slots=True)
class SoakResult:
    """What a soak found. ``held`` are the properties that were watched and not seen broken."""

    options: SoakOptions
    tally: Tally
    booked_ml: float
    true_ml: float
    disobeyed_ml: float
    worst_stop_s: float
    worst_estop_s: float
    memory: MemoryCurve
    held: tuple[str, ...]
    violations: tuple[Violation, ...]
    times_broken: dict[str, int]


class Soak:
    """``on_progress`` is told after every life of how far it came, and of how many properties were seen broken."""

    def __init__(self, options: SoakOptions, on_progress: Callable[[Tally, int], None]) -> None:
        self._options, self._on_progress = options, on_progress
        _make(options.folder)
        self._fates = np.random.default_rng([options.seed, 0xBAD])
        self._operator = Operator(np.random.default_rng([options.seed, 0x0FE]))
        self._wall, self._memory, self._tally = WallClock(), MemoryCurve(), Tally()
        self._grower = RowGrower(options.folder, options.seed)
        self._row = self._grower.next()
        court = Court(MachineTruth(self._row.twin), rules_of(self._row.config))
        self._court, self._account = court, Account(court)
        self._openings, self._permission = Openings(court), Permission(court)
        watching = (self._openings, self._account, self._permission, Motion(court), Leases(court), Liveness(court))
        self._bench = Bench(court, watching)
        self._truth_file = TruthLog(options.truth) if options.truth is not None else None
        self._watch = Watch(self._bench, self._truth_file)
        self._detector = self._reader()
        self._folders = 0
        self._folder = self._new_ledger()
        self._tasks_before = 0

    def run(self) -> SoakResult:
        """To the last hour; Ctrl-C ends it early, with what was seen until then."""
        began_s = time.monotonic()
        self._memory.look(0.0)
        try:
            while self._now_s < self._options.hours * HOUR_S:
                self._one_life()
                self._tally.real_s = time.monotonic() - began_s
                self._tally.simulated_s = self._now_s
                self._memory.look(self._now_s / HOUR_S)
                self._on_progress(self._tally, len(self._court.violations))
        except KeyboardInterrupt:
            self._tally.endings["interrupted by a person"] += 1
        finally:
            self._court.ledger.close()
            if self._truth_file is not None:
                self._truth_file.close()
        return self._result()

    @property
    def _now_s(self) -> float:
        return self._watch.origin_s + self._row.twin.now_s

    def _one_life(self) -> None:
        drawn = draw(self._fates)
        self._hand_over(drawn)
        after_kill = self._options.folder / f"ledger-{self._folders + 1}"
        life = Life(
            self._row, self._detector, self._folder, after_kill, drawn, self._watch, self._bench, self._wall
        )  # fmt: skip
        left_s = self._options.hours * HOUR_S - self._now_s
        end = life.run(resume=self._court.ledger.tasks > self._tasks_before, most_s=left_s)
        self._row.twin.advance(end.lasted_s)
        if end.killed:
            self._move_into(after_kill)
            self._rest()
        self._court.t_s = max(self._court.t_s, self._now_s)
        self._bench.end()
        self._count(drawn, end)
        del life
        gc.collect()  # a process that has gone leaves nothing behind
        self._go_on(end)

    def _hand_over(self, drawn: Misfortunes) -> None:
        """The next process takes the machine over as it stands, and its clock starts at 0."""
        twin, court = self._row.twin, self._court
        court.truth.before_another_plan()
        there_s, was_s = self._now_s, twin.physics.t_s
        twin.begin(self._watch, drawn.plan)
        self._watch.origin_s = court.t_s = there_s + (twin.physics.t_s - was_s)
        court.clean = not (drawn.faults or drawn.mishaps) and court.truth.was_sound
        self._bench.begin()

    def _go_on(self, end: LifeEnd) -> None:
        """What the operator does until the next life."""
        twin = self._row.twin
        if not end.row_done and self._operator.patience_left(end):
            wait_s = self._operator.waits_s(end)
            twin.advance(twin.now_s + 0.5 * wait_s)
            self._operator.puts_right(twin, end)
            twin.advance(twin.now_s + 0.5 * wait_s)
            return
        self._tally.rows_done += end.row_done
        self._tally.rows_left += not end.row_done
        self._rest()
        twin.advance(twin.now_s + self._operator.turns_to_next_row())
        self._next_row()

    def _next_row(self) -> None:
        now_s = self._now_s
        self._account.new_row()
        self._row = self._grower.next()
        self._court.truth = MachineTruth(self._row.twin)
        self._court.rules = rules_of(self._row.config)
        self._detector = self._reader()
        self._watch.origin_s = now_s
        if now_s - self._ledger_since_s >= LEDGER_H * HOUR_S:
            shutil.rmtree(self._folder)
            self._folder = self._new_ledger()
        self._tasks_before = self._court.ledger.tasks

    def _new_ledger(self) -> Path:
        self._folders += 1
        self._ledger_since_s = self._court.t_s
        folder = self._options.folder / f"ledger-{self._folders}"
        self._court.ledger.begin(ledger_path(folder))
        return folder

    def _move_into(self, after_kill: Path) -> None:
        """The ledger as it lay on disk at the kill is the one that the next process finds."""
        self._folders += 1
        self._court.ledger.follow(ledger_path(after_kill))
        shutil.rmtree(self._folder)
        self._folder = after_kill

    def _rest(self) -> None:
        """Every timer of a machine that nobody commands runs out."""
        twin, limit_s = self._row.twin, self._row.twin.now_s + LONGEST_REST_S
        while not twin.physics.resting and twin.now_s < limit_s:
            twin.advance(twin.now_s + REST_STEP_S)

    def _reader(self) -> TruthReader:
        row = self._row
        return TruthReader(row.renderer, row.twin.greenhouse.fruits, row.config.twin.seed, Errors())

    def _count(self, drawn: Misfortunes, end: LifeEnd) -> None:
        tally = self._tally
        tally.lives += 1
        tally.running_s += end.lasted_s
        tally.shots = self._openings.openings
        tally.happened.update(drawn.until(end.lasted_s, end.killed))
        tally.endings[end.kind] += 1

    def _result(self) -> SoakResult:
        court = self._court
        return SoakResult(
            options=self._options,
            tally=self._tally,
            booked_ml=court.ledger.booked_ml,
            true_ml=self._account.all_true_ml,
            disobeyed_ml=self._account.all_disobeyed_ml,
            worst_stop_s=self._openings.worst_stop_s,
            worst_estop_s=self._permission.worst_estop_s,
            memory=self._memory,
            held=tuple(name for name in self._bench.names if name not in court.violations),
            violations=tuple(court.violations.values()),
            times_broken=dict(court.broken),
        )


def _make(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise FileError(f"{folder}: cannot be created ({error.strerror}); choose another with --out") from error

"""What a report is made from: one task of a ledger."""

from __future__ import annotations

from dataclasses import dataclass

from robot.errors import UsageError
from robot.ledger import EventRow, LedgerReader, ShotRow, StopRow, Task, Totals
from robot.targets import Target


@dataclass(frozen=True, slots=True)
class Evidence:
    """Everything that the ledger holds about a task."""

    task_id: int
    task: Task
    targets: tuple[Target, ...]
    shots: tuple[ShotRow, ...]
    stops: tuple[StopRow, ...]
    events: tuple[EventRow, ...]
    totals: Totals

    @property
    def runs(self) -> tuple[int, ...]:
        """The runs that worked on the task, in order."""
        return tuple(sorted({shot.run_id for shot in self.shots}))


def read_evidence(ledger: LedgerReader, task_id: int | None = None) -> Evidence:
    """Read a task, the newest when none is named. ``UsageError`` for a ledger without tasks."""
    chosen = ledger.latest_task() if task_id is None else task_id
    if chosen is None:
        raise UsageError(f"{ledger.path}: holds no task yet; run one first (sprayer demo)")
    return Evidence(
        task_id=chosen,
        task=ledger.task(chosen),
        targets=ledger.targets(chosen),
        shots=ledger.shots(chosen),
        stops=ledger.stops(chosen),
        events=ledger.events(),
        totals=ledger.totals(chosen),
    )

"""The task of the ledger that the mission works on: a new one, or one to go on with."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from datetime import datetime

from robot import safety
from robot.actuation import LEDGER_WRITE_S, Actuation
from robot.clock import work
from robot.control import Declined, TaskChoice
from robot.errors import ConfigError, UsageError
from robot.ledger import Ledger
from robot.ledger.values import Checkpoint, Task
from robot.mission import Progress, State, rewound
from robot.runtime.resuming import BY_HAND, given_before, tank_left_ml, task_to_resume


@dataclass(slots=True, eq=False)
class OpenTask:
    """A task as this life works on it.

    ``checkpoint`` is where an earlier life left the rover; ``placed`` that this life knows where it stands; ``done``
    that the row came to its end. ``left_ml`` and ``given`` are the tank and what counts for the caps when it is opened.
    """

    id: int
    progress: Progress = field(default_factory=Progress)
    checkpoint: Checkpoint | None = None
    placed: bool = False
    done: bool = False
    left_ml: float = 0.0
    given: safety.Given = field(default_factory=safety.Given)


class Tasks:
    """Opens tasks. ``remembers``: an earlier life's task can be gone on with (a new simulated machine knows none).

    ``clock`` is the loop's and ``utc`` the wall's, read from any thread.
    """

    def __init__(
        self, ledger: Ledger, actuation: Actuation, today: Task, remembers: bool, clock: Callable[[], float],
        utc: Callable[[], datetime],
    ) -> None:  # fmt: skip
        self._ledger, self._actuation, self._today, self._remembers = ledger, actuation, today, remembers
        self._clock, self._utc = clock, utc
        self.current: OpenTask | None = None

    def open(self, resume: bool) -> OpenTask:
        """A new task, with a full tank, at the row's start; or the unfinished one of this life, or the newest of an
        earlier one, as the ledger knows it. Reads and writes the ledger: not for the loop of a machine that moves."""
        if not resume:
            task_id = self._ledger.begin_task(self._today)
            return OpenTask(task_id, left_ml=self._today.tank_fill_ml, given=self._given(task_id))
        task = self.current
        if task is None or task.done:
            task = self._reopen()
        rewound(task.progress, self._ledger, task.id)
        return task

    def adopt(self, task: OpenTask) -> None:
        """Make it the task that is sprayed for. Of one that was so before, safety remembers what was given."""
        if task is not self.current:
            self._actuation.begin_task(task.id, task.left_ml, task.given)
            self.current = task

    async def to_refill_for(self) -> int:
        """The task whose tank may be filled again. ``Declined`` without an unfinished one."""
        number = await work(self._unfinished, LEDGER_WRITE_S)
        if number is None:
            raise Declined(
                f"no task is unfinished, and a new one begins with {self._today.tank_fill_ml:.0f} ml in the tank "
                "(task.tank_fill_ml); fill in as much, and start it"
            )
        return number

    async def refill(self, number: int, tank_ml: float, cause: str) -> None:
        """The tank holds ``tank_ml`` from this moment on: on disk first, then for the mission that goes on."""
        before_ml, stamp_s = self._actuation.tank_left_ml, self._clock()
        await work(lambda: self._ledger.write_refill(number, tank_ml, cause, stamp_s), LEDGER_WRITE_S)
        meanwhile_ml = before_ml - self._actuation.tank_left_ml
        self._actuation.refilled(tank_ml - meanwhile_ml)

    async def plan(self, choice: TaskChoice) -> tuple[int | None, int, float, float]:
        """(the task to go on with or None, its first stop, millilitres in the tank, millilitres the label leaves)."""
        number = None if choice is TaskChoice.NEW else await work(self._unfinished, LEDGER_WRITE_S)
        if number is None:
            if choice is TaskChoice.RESUME:
                raise Declined("there is no unfinished task to go on with; ask for a new one")
            return None, 1, self._today.tank_fill_ml, self._today.label_cap_ml
        try:
            await work(lambda: task_to_resume(self._ledger, self._today), LEDGER_WRITE_S)
        except (ConfigError, UsageError) as error:
            raise Declined(f"{error}; or ask for a new task") from error
        total_ml = (await work(lambda: self._given(number), LEDGER_WRITE_S)).task_ml
        if self.current is not None and self.current.id == number:
            stop, left_ml = self.current.progress.stop, self._actuation.tank_left_ml
        else:
            checkpoint = await work(lambda: self._ledger.last_checkpoint(number), LEDGER_WRITE_S)
            stop = checkpoint.stop if checkpoint else 0
            left_ml = await work(lambda: self._left_ml(number, total_ml), LEDGER_WRITE_S)
        return number, max(1, stop), left_ml, self._today.label_cap_ml - total_ml

    def _unfinished(self) -> int | None:
        """The newest task of a row whose mission did not come to its end; None when there is none."""
        if self.current is not None:
            return None if self.current.done else self.current.id
        if not self._remembers:
            return None
        rows = [row.task_id for row in self._ledger.tasks() if self._ledger.task(row.task_id).route != BY_HAND]
        states = self._ledger.events("state")
        done = bool(states) and states[-1].text.startswith(State.DONE)
        return rows[-1] if rows and not done else None

    def _reopen(self) -> OpenTask:
        task_id = task_to_resume(self._ledger, self._today)
        checkpoint = self._ledger.last_checkpoint(task_id)
        given = self._given(task_id)
        return OpenTask(
            task_id,
            Progress(stop=checkpoint.stop if checkpoint else 0),
            checkpoint,
            left_ml=self._left_ml(task_id, given.task_ml),
            given=given,
        )

    def _given(self, task_id: int) -> safety.Given:
        return given_before(self._ledger, task_id, self._utc(), self._clock())

    def _left_ml(self, task_id: int, given_ml: float) -> float:
        return tank_left_ml(self._ledger, task_id, self._today.tank_fill_ml, given_ml)

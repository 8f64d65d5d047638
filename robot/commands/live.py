"""Live progress in the terminal: mode, state, stop, targets, millilitres, time to go."""

from __future__ import annotations

import asyncio
from collections import deque
from types import TracebackType
from typing import Self

from rich.console import Console
from rich.live import Live
from rich.table import Table
from rich.text import Text

from robot.events import Bus
from robot.mission import BookChanged, LightSeen, ShotDone, State, StateEntered, TargetSkipped, Trouble
from robot.report import light_words
from robot.runtime import ModeChanged, RunBegan
from robot.targets import TargetState

NOTES_KEPT = 200


class LiveView:
    """Listens on the bus and redraws a few lines on stderr; on a pipe it prints a line a change instead."""

    def __init__(self, bus: Bus) -> None:
        self._console = Console(stderr=True)
        self._heard = bus.subscribe(
            StateEntered, BookChanged, LightSeen, ShotDone, TargetSkipped, Trouble, ModeChanged, RunBegan
        )
        self._task: asyncio.Task[None] | None = None
        self._mode, self._state = "disarmed", "idle"
        self._stop = self._stops = self._shots = self._skipped = 0
        self._fates: dict[TargetState, int] = {}
        self._booked_ml = 0.0
        self._light = "not metered yet"
        self._now_s = 0.0
        self._first_stop_s: float | None = None
        self._notes: deque[str] = deque(maxlen=NOTES_KEPT)
        self._live = Live(self._table(), console=self._console, refresh_per_second=8, transient=True)

    async def __aenter__(self) -> Self:
        if self._console.is_terminal:
            self._live.start()
        self._task = asyncio.create_task(self._listen(), name="live view")
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._task is not None:
            self._task.cancel()
        for event in self._heard.drain():
            self._take(event)
        self._live.stop()
        for note in self._notes:
            self._console.print(Text(note, style="yellow"), soft_wrap=True)

    async def _listen(self) -> None:
        async for event in self._heard:
            self._take(event)
            self._live.update(self._table())

    def _take(self, event: object) -> None:
        if isinstance(event, RunBegan):
            self._stops = event.stops
            for open_shot in event.dangling:
                intent = open_shot.intent
                self._note(
                    f"task {open_shot.task_id}: the shot at target {intent.target_id} had no outcome; "
                    f"booked as its full pulse, {intent.full_ml:.1f} ml"
                )
            if event.waiting:
                orders = f"orders at {event.control}" if event.control else "virtual time: no control socket"
                self._say(f"up, disarmed, waiting (Ctrl-C ends); {orders}")
        elif isinstance(event, ModeChanged):
            self._mode = str(event.mode)
            if event.causes:
                self._note(f"{event.mode}: {event.causes[-1]}")
        elif isinstance(event, StateEntered):
            self._enter(event)
        elif isinstance(event, BookChanged):
            self._fates = {
                state: sum(target.state is state for target in event.book.targets) for state in TargetState
            }
        elif isinstance(event, LightSeen):
            self._light = light_words(event.light)
        elif isinstance(event, ShotDone):
            self._shots += 1
            self._booked_ml += event.booked_ml
        elif isinstance(event, TargetSkipped):
            self._skipped += 1
        elif isinstance(event, Trouble):
            self._note(event.text)

    def _enter(self, event: StateEntered) -> None:
        self._state, self._now_s = str(event.state), event.stamp_s
        if event.stop != self._stop:
            self._stop = event.stop
            if self._first_stop_s is None:
                self._first_stop_s = event.stamp_s
            self._say(f"stop {event.stop} of {event.stops} at {event.stamp_s:.0f} s")
        if event.state is State.DONE:
            self._say(f"row done after {event.stamp_s:.0f} s")

    def _note(self, text: str) -> None:
        """What a person should know: at once, and at a terminal, which is redrawn, again at the end."""
        if self._console.is_terminal:
            self._notes.append(text)
        else:
            self._console.print(Text(text, style="yellow"), soft_wrap=True)

    def _say(self, text: str) -> None:
        """One line where there is no terminal to redraw (a journal, a pipe)."""
        if not self._console.is_terminal:
            self._console.print(Text(text), soft_wrap=True)

    def _table(self) -> Table:
        table = Table.grid(padding=(0, 2))
        fates = "  ".join(f"{state.value} {count}" for state, count in self._fates.items() if count)
        table.add_row(Text(self._mode.upper(), style="bold"), Text(self._state.upper(), style="bold green"))
        table.add_row("stop", f"{self._stop} of {self._stops}")
        table.add_row("targets", fates or "none yet")
        table.add_row("shots", f"{self._shots}, {self._booked_ml:.1f} ml booked")
        table.add_row("light", self._light)
        table.add_row("time", f"{self._now_s:.0f} s, {self._to_go()}")
        if self._notes:
            table.add_row("last", Text(self._notes[-1], style="yellow"))
        return table

    def _to_go(self) -> str:
        """Remaining time from the mean time a stop took so far."""
        if self._first_stop_s is None or self._stop < 2 or self._stops == 0:
            return "to go: not known yet"
        each_s = (self._now_s - self._first_stop_s) / (self._stop - 1)
        return f"to go: about {each_s * (self._stops - self._stop + 1):.0f} s"

"""The life of a run as log lines, where a journal listens instead of a person."""

from __future__ import annotations

import asyncio
import logging
from types import TracebackType
from typing import Self

from robot import safety
from robot.events import Bus
from robot.logs import LimitedHandler, fields
from robot.mission import ShotDone, State, StateEntered, TargetSkipped, Trouble
from robot.runtime import ModeChanged, RunBegan

COUNTS_EVERY_S = 10.0

_log = logging.getLogger("robot.run")


class EventLog:
    """Listens on the bus. ``handler`` is asked now and then to write how many lines it held back."""

    def __init__(self, bus: Bus, handler: LimitedHandler) -> None:
        self._heard = bus.subscribe(RunBegan, ModeChanged, Trouble, StateEntered, ShotDone, TargetSkipped)
        self._handler = handler
        self._tasks: list[asyncio.Task[None]] = []
        self._stop = 0

    async def __aenter__(self) -> Self:
        self._tasks = [
            asyncio.create_task(self._listen(), name="event log"),
            asyncio.create_task(self._count(), name="counts of the log"),
        ]
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for task in self._tasks:
            task.cancel()
        for event in self._heard.drain():
            self._write(event)

    async def _listen(self) -> None:
        async for event in self._heard:
            self._write(event)

    async def _count(self) -> None:
        while True:
            await asyncio.sleep(COUNTS_EVERY_S)
            self._handler.write_counts()

    def _write(self, event: object) -> None:
        if isinstance(event, RunBegan):
            _log.info("up", extra=fields(waiting=event.waiting, task=event.task_id, control=event.control))
            for open_shot in event.dangling:
                shot = fields(
                    task=open_shot.task_id, target=open_shot.intent.target_id, ml=open_shot.intent.full_ml
                )
                _log.warning("a shot had no outcome, booked as its full pulse", extra=shot)
        elif isinstance(event, ModeChanged):
            latched = event.mode in (safety.Mode.SAFE_STOP, safety.Mode.ESTOP)
            level = logging.ERROR if latched else logging.INFO
            _log.log(level, "mode %s", event.mode, extra=fields(causes="; ".join(event.causes), at_s=event.stamp_s))
        elif isinstance(event, Trouble):
            _log.warning("%s", event.text, extra=fields(at_s=event.stamp_s))
        elif isinstance(event, StateEntered):
            if event.stop != self._stop or event.state in (State.IDLE, State.DONE):
                self._stop = event.stop
                place = fields(stop=event.stop, stops=event.stops, reason=event.reason, at_s=event.stamp_s)
                _log.info("mission %s", event.state, extra=place)
        elif isinstance(event, ShotDone):
            ml = fields(target=event.target_id, stop=event.stop, dose_ml=event.dose_ml, booked_ml=event.booked_ml)
            _log.info("shot", extra=ml)
        elif isinstance(event, TargetSkipped):
            _log.info("target skipped: %s", event.reason, extra=fields(target=event.target_id, stop=event.stop))

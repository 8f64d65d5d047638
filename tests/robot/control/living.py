"""A robot on its mock devices in real time, in a thread of its own, with its socket: to be asked from outside."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from drivers.camera.values import Image
from drivers.twin.machine import Twin
from drivers.twin.renderer import FruitView
from robot.client import Answer, ask
from robot.clock import run_real
from robot.events import Bus
from robot.runtime import RunOptions, RunResult, StopSignals, run_robot
from tests.robot.mission.oracle import Oracle
from tests.robot.mission.rover import DEMO, configuration, simulated

STOP_M = 0.25
TINY = {"twin": {"fruits_per_plant": 2.5}}
DEADLINE_S = 30.0


class OnePicture:
    """The row as seen from its stop, drawn once and beforehand: drawing it anew would hold up the robot's loop."""

    def __init__(self, twin: Twin, stop_m: float, exposure_s: float) -> None:
        shot = twin.shot(0.0)
        seen_from = shot.row_from_camera.copy()
        seen_from[0, 3] += stop_m
        self._left, self._right = twin.renderer.render(seen_from, shot.light, exposure_s, 1.0)
        self.views = twin.renderer.truth(seen_from)

    def render(self, *_: object) -> tuple[Image, Image]:
        left, right = self._left.copy(), self._right.copy()
        for picture in (left, right):  # no two pictures of a living camera are the same
            picture[::7, ::7] ^= 1
        self._left, self._right = left, right
        return left, right

    def truth(self, *_: object) -> tuple[FruitView, ...]:
        return self.views


@dataclass(frozen=True, eq=False)
class Living:
    """``twin`` belongs to the robot's thread: look at it once the robot is gone, or at what changes slowly."""

    path: Path
    folder: Path
    twin: Twin
    result: list[RunResult]

    def get(self, place: str) -> Answer:
        return ask(self.path, "GET", place)

    def post(self, verb: str, **values: object) -> Answer:
        return ask(self.path, "POST", f"/v1/{verb}", values)

    def until(self, holds: Callable[[], bool]) -> None:
        deadline = time.monotonic() + DEADLINE_S
        while not holds():
            assert time.monotonic() < deadline, self.get("/v1/status").body
            time.sleep(0.005)


class _Told(StopSignals):
    """What ends the robot, from another thread than the main one."""

    def end(self) -> None:
        self.name = "SIGTERM"
        if self._loop is not None:
            self._loop.call_soon_threadsafe(self._came.set)


@contextmanager
def living(folder: Path, **changes) -> Iterator[Living]:  # type: ignore[no-untyped-def]
    """Up and waiting for orders, until the block ends."""
    config = configuration(folder, (STOP_M,), 0.5, "left", TINY | changes)
    path = folder / "control.sock"
    options = RunOptions(DEMO, folder / "run", False, False, folder / "truth.jsonl", control=path)
    twin = simulated(config, options, ())
    picture = OnePicture(twin, STOP_M, config.camera.exposure_s)
    twin.renderer = picture  # type: ignore[assignment]
    detector = Oracle(picture, twin.greenhouse.fruits)  # type: ignore[arg-type]
    told, result = _Told(), []

    def life() -> None:
        result.append(run_real(run_robot(config, options, Bus(), detector=detector, twin=twin, signals=told)))

    thread = threading.Thread(target=life, name="robot")
    thread.start()
    try:
        robot = Living(path, folder, twin, result)
        deadline = time.monotonic() + DEADLINE_S
        while thread.is_alive() and time.monotonic() < deadline and not path.exists():
            time.sleep(0.02)
        robot.get("/v1/status")  # answered once it is up
        yield robot
    finally:
        told.end()
        thread.join(DEADLINE_S)
        assert not thread.is_alive()

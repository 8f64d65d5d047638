"""Whole missions of the demo machine in virtual time, with the oracle for a detector, and what became of them."""

from __future__ import annotations

import asyncio
import tomllib
from collections.abc import Awaitable, Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from drivers.relay.values import Channel
from drivers.twin.aftermath import resume_from
from drivers.twin.commands import Command
from drivers.twin.faults import FaultPlan, parse_fault
from drivers.twin.machine import Twin
from drivers.twin.optics import StereoOptics
from drivers.twin.plants import grow
from drivers.twin.scene import Scene
from drivers.twin.truth_record import TruthRecord, read_truth
from robot import safety
from robot.calibration_file import load_rig
from robot.clock import run_virtual
from robot.config import Config
from robot.control import Machine
from robot.events import Bus
from robot.ledger import LedgerReader
from robot.ledger.records import ShotRow, Totals
from robot.mission import FrameSeen, State, StateEntered, TargetSkipped, Trouble
from robot.package_files import packaged
from robot.report.evidence import Evidence, read_evidence
from robot.runtime import ModeChanged, RunBegan, RunOptions, RunResult, ledger_path, run_robot
from robot.runtime.devices import nominal_machine
from robot.runtime.settings import load_arm, load_row
from robot.targets import Target
from robot.vision.detector import Detector

from .oracle import Oracle, WatchedRenderer

DEMO = packaged("configs") / "demo.toml"

Changes = Mapping[str, Mapping[str, object]]


@dataclass(eq=False)
class World:
    """The simulated machine while the robot lives, for somebody who meddles with it."""

    twin: Twin
    bus: Bus
    entered: Any = field(init=False)
    began: Any = field(init=False)

    def __post_init__(self) -> None:
        self.entered = self.bus.subscribe(StateEntered)
        self.began = self.bus.subscribe(RunBegan)

    @property
    def now_s(self) -> float:
        return asyncio.get_running_loop().time()

    async def machine(self) -> Machine:
        """Who takes orders, once every device has reported."""
        machine: Machine = (await self.began.next()).machine
        await asyncio.sleep(1.0)
        return machine

    def suffer(self, command: Command) -> None:
        self.twin.apply(self.now_s, command)

    async def until(self, state: State, count: int = 1) -> StateEntered:
        """The ``count``-th entry of ``state`` from now on."""
        while True:
            event: StateEntered = await self.entered.next()
            count -= event.state is state
            if count == 0:
                return event

    async def until_on(self, channel: Channel) -> None:
        while True:
            if self.twin.coils(self.now_s)[channel]:
                return
            await asyncio.sleep(0.005)

    async def until_valve_opens(self) -> None:
        while not self.twin.valve_open:
            await asyncio.sleep(0.002)
            self.twin.advance(self.now_s)


Meddler = Callable[[World], Awaitable[None]]


@dataclass(frozen=True, eq=False)
class Shaken:
    """What the nozzle did while the valve was open, in the twin's truth."""

    joints_rad: float
    nozzle_m: float


class Witness:
    """Looks at the arm whenever the true valve moves. Stands between the twin and its truth file."""

    def __init__(self, twin: Twin) -> None:
        self._twin, self._log = twin, twin.truth
        self.shaken: list[Shaken] = []
        self._joints, self._nozzle_m = twin.joints_rad, twin.nozzle_pose[:3, 3]

    @property
    def keeps(self) -> bool:
        return self._log.keeps

    def append(self, line: Mapping[str, Any]) -> None:
        if line.get("what") in ("valve_opened", "valve_closed"):
            joints, nozzle_m = self._twin.joints_rad, self._twin.nozzle_pose[:3, 3]
            if line["what"] == "valve_closed":
                turned = float(np.abs(joints - self._joints).max())
                self.shaken.append(Shaken(turned, float(np.linalg.norm(nozzle_m - self._nozzle_m))))
            self._joints, self._nozzle_m = joints, nozzle_m
        self._log.append(line)

    def close(self) -> None:
        self._log.close()


@dataclass(frozen=True, eq=False, repr=False)
class Run:
    """A run that is over: what the robot said, what it booked, and what truly happened."""

    config: Config
    result: RunResult
    states: list[StateEntered]
    troubles: list[Trouble]
    frames: list[FrameSeen]
    skips: list[TargetSkipped]
    modes: list[ModeChanged]
    evidence: Evidence | None
    targets: tuple[Target, ...]
    shots: tuple[ShotRow, ...]
    totals: Totals
    events: tuple[Any, ...]
    dangling: int
    truth: TruthRecord
    twin: Twin
    shaken: list[Shaken]

    def spans(self, state: State) -> list[tuple[float, float]]:
        """When the mission was in ``state``, from and to."""
        ends = [*(entered.stamp_s for entered in self.states[1:]), self.last_s]
        stays = zip(self.states, ends, strict=True)
        return [(entered.stamp_s, end) for entered, end in stays if entered.state is state and end > entered.stamp_s]

    def run_on(self, seconds: float = 40.0) -> Twin:
        """The machine after the program has gone: every timer runs out."""
        self.twin.advance(self.twin.now_s + seconds)
        return self.twin

    @property
    def said(self) -> str:
        """All that a person could read of what went wrong."""
        return "\n".join([*(trouble.text for trouble in self.troubles), *self.result.causes])

    @property
    def latched_s(self) -> float:
        """When the machine was first stopped."""
        return next(item.stamp_s for item in self.modes if item.mode in (safety.Mode.SAFE_STOP, safety.Mode.ESTOP))

    @property
    def last_s(self) -> float:
        """When the run ended, in loop time."""
        return self.result.duration_s


def configuration(folder: Path, stops_m: tuple[float, ...], length_m: float, side: str, changes: Changes) -> Config:
    """The demo's configuration with other values, and a row of its own."""
    route = folder / "route.toml"
    route.write_text(
        f'name = "test"\n[[row]]\nname = "A"\nside = "{side}"\nlength_m = {length_m}\nstops_m = {list(stops_m)}\n'
    )
    raw = tomllib.loads(DEMO.read_text())
    merged: dict[str, dict[str, object]] = {"rig": {"side": side}, "navigation": {"route": str(route)}}
    for section, values in changes.items():
        merged.setdefault(section, {}).update(values)
    for section, values in merged.items():
        raw.setdefault(section, {}).update(values)
    return Config(**raw)


def spray_row(
    folder: Path,
    stops_m: tuple[float, ...] = (0.3, 0.7),
    length_m: float = 1.6,
    side: str = "left",
    faults: tuple[str, ...] = (),
    meddler: Meddler | None = None,
    resume: bool = False,
    start: bool = True,
    eyes: Callable[[Oracle], Detector] = lambda oracle: oracle,
    config_path: Path = DEMO,
    **changes: Mapping[str, object],
) -> Run:
    """One life of the robot on a row; ``changes`` are values of the configuration by section, ``eyes`` what it detects
    with, ``config_path`` the file that it takes its configuration to be from."""
    config = configuration(folder, stops_m, length_m, side, changes)
    options = RunOptions(config_path, folder / "run", start, resume, folder / "truth.jsonl")
    twin = simulated(config, options, faults)
    witness = Witness(twin)
    twin.truth = witness  # type: ignore[assignment]
    oracle = Oracle(twin.renderer, twin.greenhouse.fruits)  # type: ignore[arg-type]
    bus = Bus()
    heard = bus.subscribe(StateEntered, Trouble, FrameSeen, TargetSkipped, ModeChanged)

    async def life() -> RunResult:
        meddling = asyncio.ensure_future(meddler(World(twin, bus))) if meddler is not None else None
        try:
            return await run_robot(config, options, bus, detector=eyes(oracle), twin=twin)
        finally:
            if meddling is not None:
                if meddling.done():
                    meddling.result()
                meddling.cancel()
                with suppress(asyncio.CancelledError):
                    await meddling

    result = run_virtual(life())
    told = heard.drain()
    with LedgerReader.open_read_only(ledger_path(options.folder)) as ledger:
        task_id = result.task_id or ledger.latest_task()
        evidence = None if task_id is None else read_evidence(ledger, task_id)
        return Run(
            config, result,
            [item for item in told if isinstance(item, StateEntered)],
            [item for item in told if isinstance(item, Trouble)],
            [item for item in told if isinstance(item, FrameSeen)],
            [item for item in told if isinstance(item, TargetSkipped)],
            [item for item in told if isinstance(item, ModeChanged)],
            evidence, ledger.targets(task_id), ledger.shots(task_id), ledger.totals(task_id),
            ledger.events(), len(ledger.dangling()), read_truth(folder / "truth.jsonl"), twin,
            witness.shaken,
        )  # fmt: skip


def simulated(config: Config, options: RunOptions, faults: tuple[str, ...]) -> Twin:
    """The twin that the robot would make of its configuration, with faults."""
    _, urdf = load_arm(config, DEMO)
    row = load_row(config, DEMO)
    nominal = nominal_machine(config, load_rig(packaged("configs") / config.camera.calibration), urdf)
    scene = Scene(
        seed=config.twin.seed, hour=config.twin.hour, row_length_m=row.length_m, side=row.side,
        plant_spacing_m=config.plants.spacing_m, stem_distance_m=config.plants.stem_distance_m,
        fruits_per_plant=config.twin.fruits_per_plant,
    )  # fmt: skip
    assert options.truth is not None
    twin = resume_from(
        options.truth, nominal, scene, config.twin.seed, FaultPlan(parse_fault(text) for text in faults)
    )
    twin.renderer = _renderer(scene, nominal.optics, config.twin.seed)  # shadows of a row are worked out once
    return twin


_RENDERERS: dict[tuple[Scene, int], WatchedRenderer] = {}


def _renderer(scene: Scene, optics: StereoOptics, seed: int) -> WatchedRenderer:
    if (scene, seed) not in _RENDERERS:
        _RENDERERS[scene, seed] = WatchedRenderer(grow(scene), optics, seed)
    return _RENDERERS[scene, seed]

"""Sessions by hand on the demo machine in virtual time, and what truly became of it."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from drivers.twin.aftermath import Aftermath, run_on
from drivers.twin.commands import ArmGoal, RelayPulse, WheelsDrive
from drivers.twin.machine import Twin
from drivers.twin.truth_record import ProcessTruth, read_truth
from robot.clock import run_virtual
from robot.commands.run import single_error
from robot.config import load_config
from robot.ledger import EventRow, LedgerReader, ShotRow
from robot.package_files import packaged
from robot.runtime import StopSignals, ledger_path
from robot.runtime.manual import ByHand, ManualOptions, building, manual

DEMO = packaged("configs") / "demo.toml"
Act = Callable[[ByHand, Twin], Awaitable[None]]


@dataclass(frozen=True, eq=False)
class Session:
    """A session that is over: how it ended, what was told, what is written, and the machine's truth."""

    error: Exception | None
    told: list[str]
    twin: Twin
    process: ProcessTruth
    shots: tuple[ShotRow, ...]
    events: tuple[EventRow, ...]
    path: Path = field(repr=False)

    @property
    def modes(self) -> list[str]:
        return [event.text.split()[0] for event in self.events if event.kind == "mode"]

    @property
    def after(self) -> Aftermath:
        """The machine when everything has run out."""
        return run_on(self.path)

    def asked_after(self, t_s: float) -> list[float]:
        """Times of later commands that set something in motion or open the valve."""
        return [
            timed.t for timed in self.process.commands
            if timed.t > t_s and (isinstance(timed.command, ArmGoal | RelayPulse) or _drives(timed.command))
        ]  # fmt: skip

    def latched_s(self) -> float:
        return next(event.stamp_s for event in self.events if event.kind == "mode" and "stop" in event.text.split()[0])


def _drives(command: object) -> bool:
    return isinstance(command, WheelsDrive) and (command.speed_m_s, command.yaw_rate_rad_s) != (0.0, 0.0)


def by_hand(folder: Path, act: Act, *faults: str) -> Session:
    """One session with ``act`` in it, to its end whatever that is."""
    told: list[str] = []
    twins: list[Twin] = []
    make_twin = building.make_twin

    def watched(*arguments: object, **more: object) -> Twin:
        twins.append(make_twin(*arguments, **more))  # type: ignore[arg-type]
        return twins[-1]

    options = ManualOptions(DEMO, folder, folder / "truth.jsonl", faults=faults)
    error: Exception | None = None

    async def session(signals: StopSignals) -> None:
        async with manual(load_config(DEMO), options, signals, told.append) as hands:
            await act(hands, twins[0])

    with pytest.MonkeyPatch.context() as patch, StopSignals() as signals:
        patch.setattr(building, "make_twin", watched)
        try:
            run_virtual(session(signals))
        except ExceptionGroup as group:
            error = single_error(group)
        except Exception as alone:  # noqa: BLE001 - every end is looked at by the test
            error = alone
    with LedgerReader.open_read_only(ledger_path(folder)) as ledger:
        task_id = ledger.latest_task()
        shots = () if task_id is None else ledger.shots(task_id)
        events = ledger.events()
    return Session(
        error, told, twins[0], read_truth(options.truth).processes[-1], shots, events, folder / "truth.jsonl"
    )


async def until_valve_opens(hands: ByHand, twin: Twin) -> None:
    while not twin.valve_open:
        await asyncio.sleep(0.002)
        twin.advance(hands.now_s())

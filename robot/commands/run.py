"""``sprayer run``: one life of the robot."""

from __future__ import annotations

import asyncio
import json
import math
import os
import sys
from contextlib import AbstractAsyncContextManager, ExitStack
from dataclasses import asdict, replace
from pathlib import Path
from typing import Annotated, Any

import typer

from robot.atomic_file import atomic_file
from robot.client import socket_path
from robot.clock import RealClockLoop, run_real, run_virtual
from robot.commands.event_log import EventLog
from robot.commands.live import LiveView
from robot.config import MAX_SEED, Config, load_config
from robot.errors import FileError, UsageError
from robot.events import Bus
from robot.ledger import LedgerReader
from robot.logs import journal_handler
from robot.mission import State
from robot.package_files import config_file
from robot.runtime import EmulatorOptions, RunOptions, RunResult, StopSignals, emulator_process, ledger_path, run_robot
from robot.runtime.devices import fault_plan
from robot.targets import TargetState

DISK_FAULTS = ("[F36]", "[F38]")  # the ledger could not be written

ConfigOption = Annotated[Path, typer.Option("--config", help="Configuration file, or the name of one that came along.")]
SeedOption = Annotated[
    int | None, typer.Option("--seed", min=0, max=MAX_SEED, help="Seed of the simulated greenhouse and machine.")
]
FaultOption = Annotated[
    list[str] | None,
    typer.Option("--fault", metavar="DEVICE:VERB@T+D", help="A fault of the simulation, like relay:garbage@12s+3s."),
]
TraceOption = Annotated[
    Path | None, typer.Option("--trace", metavar="DIR", help="Keep every byte of every port in this folder.")
]
SpeedOption = Annotated[
    float, typer.Option("--speed", min=0.0, help="Simulated seconds a second; 0 is as fast as the machine can.")
]


def run(
    config: ConfigOption,
    seed: SeedOption = None,
    start: Annotated[bool, typer.Option("--start", help="Arm and start at once (simulation), or after a yes.")] = False,
    resume: Annotated[bool, typer.Option("--resume", help="Go on with the last row instead of a new one.")] = False,
    summary: Annotated[Path | None, typer.Option("--summary", help="Write the result to this JSON file.")] = None,
    truth: Annotated[Path | None, typer.Option("--truth", help="Where the simulation writes what happened.")] = None,
    speed: SpeedOption = 1.0,
    out: Annotated[Path | None, typer.Option("--out", help="Run directory; default from the configuration.")] = None,
    emulate: Annotated[bool, typer.Option("--emulate", help="Start the emulated rover beside the robot.")] = False,
    fault: FaultOption = None,
    trace: TraceOption = None,
) -> int:
    """Come up disarmed and wait for orders; with --start treat one row. Ctrl-C or SIGTERM stops clean at any moment.

    In real time it takes orders (sprayer status, arm, start, stop ...) at a control socket in its run directory, or in
    $RUNTIME_DIRECTORY. Simulated in virtual time it has none: nobody could keep up with it.
    """
    settings = load_with_seed(config, seed)
    if resume and not start:
        raise UsageError("--resume goes on with a row, so it needs --start as well")
    if emulate and not settings.emulated:
        raise UsageError(f"{config}: has no emulated rover (twin.behind is not 'emulators'); leave --emulate out")
    if start and not settings.simulated and not emulate:
        _confirm(settings)
    faults = tuple(fault or ())
    if faults and not (emulate or settings.simulated):
        raise UsageError("--fault works on the simulated machine only; use mocks or --emulate")
    fault_plan(faults)  # refused before anything is opened
    folder = out or settings.robot.run_directory
    control = socket_path(folder, os.environ)
    options = RunOptions(
        config_file(config), folder, start, resume, truth, faults=faults, trace=trace, control=control
    )
    signals = StopSignals().install()  # for good: a signal that comes after the robot let go cuts nothing
    with ExitStack() as stack:
        file = None if summary is None else stack.enter_context(atomic_file(summary))  # refused before anything moves
        result = run_with_view(settings, options, speed, signals, emulate)
        if file is not None:
            file.write(json.dumps(describe(result, options.folder), indent=2).encode("utf-8") + b"\n")
    for cause in result.causes:
        if cause.endswith(DISK_FAULTS):
            raise FileError(cause)
    return 0 if result.state is State.DONE or not start or _stopped_by_signal(result) else 1


def load_with_seed(path: Path, seed: int | None) -> Config:
    """The configuration, with the simulation's seed replaced when one is given."""
    config = load_config(path)
    if seed is None:
        return config
    return config.model_copy(update={"twin": config.twin.model_copy(update={"seed": seed})})


def run_with_view(
    config: Config, options: RunOptions, speed: float, signals: StopSignals | None = None, emulate: bool = False
) -> RunResult:
    """Run the robot with live progress on the terminal, or with log lines where a journal listens: mocks in virtual
    time, everything else in real time.

    ``emulate``: its devices are those of an emulated rover that lives as long as the run.
    """
    if math.isnan(speed):
        raise UsageError("--speed nan: expected simulated seconds a second; give a number, or 0 for as fast as can be")

    async def life(options: RunOptions) -> RunResult:
        bus = Bus()
        async with _told(bus):
            return await run_robot(config, options, bus, signals=signals)

    async def with_emulator() -> RunResult:
        loop = asyncio.get_running_loop()
        assert isinstance(loop, RealClockLoop)
        machine = EmulatorOptions(
            options.config_path, config.twin.seed, loop.zero_s, options.truth, options.faults
        )
        async with emulator_process(machine) as ports:
            return await life(replace(options, ports=ports))

    try:
        if config.simulated:
            return run_virtual(life(options), pace=speed or None)
        return run_real(with_emulator() if emulate else life(options))
    except ExceptionGroup as group:
        raise single_error(group) from group


def _told(bus: Bus) -> AbstractAsyncContextManager[object]:
    handler = journal_handler()
    return LiveView(bus) if handler is None else EventLog(bus, handler)


def single_error(group: ExceptionGroup[Exception]) -> Exception:
    """The first error of a group of tasks, which is the one that ended the others."""
    first = group.exceptions[0]
    return single_error(first) if isinstance(first, ExceptionGroup) else first


def describe(result: RunResult, folder: Path) -> dict[str, Any]:
    """The result of a run as plain values, with the ledger's sums."""
    out: dict[str, Any] = {
        "state": str(result.state),
        "mode": str(result.mode),
        "causes": list(result.causes),
        "task": result.task_id,
        "duration_s": round(result.duration_s, 3),
        "dangling": [{"task": item.task_id, **asdict(item.intent)} for item in result.dangling],
        "ledger": str(ledger_path(folder)),
    }
    if result.task_id is not None:
        with LedgerReader.open_read_only(ledger_path(folder)) as ledger:
            totals = ledger.totals(result.task_id)
            targets = ledger.targets(result.task_id)
        out["booked_ml"] = round(totals.booked_ml, 3)
        out["pending_ml"] = round(totals.pending_ml, 3)
        out["targets"] = {str(state): sum(target.state is state for target in targets) for state in TargetState}
    return out


def _stopped_by_signal(result: RunResult) -> bool:
    return any(cause.startswith("stopped by SIG") for cause in result.causes)


def _confirm(config: Config) -> None:
    if not sys.stdin.isatty():
        raise UsageError("--start with real hardware must be confirmed at a terminal; start it by hand")
    sys.stdout.write(f"{config.robot.name}: this arms REAL hardware with {config.task.product}.\n")
    if typer.prompt("Type 'spray' to start", default="", show_default=False) != "spray":
        raise UsageError("not confirmed; nothing was started")

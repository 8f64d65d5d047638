"""``sprayer emulate``: the simulated rover behind real ports, for production drivers and other programs to talk to."""

from __future__ import annotations

import asyncio
import json
import os
import sys
from contextlib import AbstractAsyncContextManager, suppress
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.table import Table

from robot.clock import RealClockLoop, keep_time
from robot.commands.run import FaultOption, SeedOption, load_with_seed
from robot.errors import UsageError
from robot.package_files import config_file
from robot.runtime.devices import fault_plan
from robot.runtime.emulation import DEVICES, emulated_rover
from robot.runtime.signals import StopSignals

RUN_ON_S = 8.0  # after the robot's process died: longer than any pulse and any braking
LOOKS_AFTER_PARENT_S = 0.2
PRIORITY = -10


def emulate(
    config: Annotated[Path, typer.Option("--config", help="Configuration of the machine to be simulated.")] = Path(
        "configs/emulated.toml"
    ),
    only: Annotated[
        list[str] | None, typer.Option("--only", metavar="DEVICE", help="Just this device; may be given again.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print the map of ports as one line of JSON.")] = False,
    fault: FaultOption = None,
    links: Annotated[
        Path | None, typer.Option("--links", metavar="DIR", help="Make stable names of the ports in this folder.")
    ] = None,
    truth: Annotated[Path | None, typer.Option("--truth", help="Where the simulation writes what happened.")] = None,
    seed: SeedOption = None,
    strict_baud: Annotated[
        bool, typer.Option("--strict-baud", help="Mishear hosts at another baud rate, as real wires do.")
    ] = False,
    zero: Annotated[float | None, typer.Option("--zero", hidden=True, help="When the clock shows 0.")] = None,
    with_parent: Annotated[
        bool, typer.Option("--with-parent", hidden=True, help="End soon after the process that started this one.")
    ] = False,
) -> int:
    """Serve the rover's devices on pseudo terminals until stopped (Ctrl-C)."""
    settings = load_with_seed(config, seed)
    devices = frozenset(only or DEVICES)
    if unknown := sorted(devices - set(DEVICES)):
        raise UsageError(f"--only {unknown[0]}: no such device; known are {', '.join(DEVICES)}")
    plan = fault_plan(fault or ())
    signals = StopSignals().install()
    with asyncio.Runner(loop_factory=lambda: RealClockLoop(zero, precise=True)) as runner:
        rover = emulated_rover(settings, config_file(config), devices, plan, links, truth, strict_baud)
        runner.run(_serve(rover, as_json, with_parent, signals))
    return 0


async def _serve(
    rover: AbstractAsyncContextManager[dict[str, str]], as_json: bool, with_parent: bool, signals: StopSignals
) -> None:
    parent = os.getppid()
    async with rover as ports:
        keep_time()
        with suppress(PermissionError):  # a machine does not wait for the computer: this thread goes first, if it may
            os.setpriority(os.PRIO_PROCESS, 0, PRIORITY)
        _print(ports, as_json)
        waiting = asyncio.ensure_future(signals.wait())
        while not waiting.done():
            await asyncio.wait({waiting}, timeout=LOOKS_AFTER_PARENT_S if with_parent else None)
            if with_parent and os.getppid() != parent:
                await asyncio.wait({waiting}, timeout=RUN_ON_S)
                break
        waiting.cancel()


def _print(ports: dict[str, str], as_json: bool) -> None:
    if as_json:
        sys.stdout.write(json.dumps(ports) + "\n")
        sys.stdout.flush()
        return
    table = Table("device", "port", title="emulated rover (Ctrl-C ends)")
    for device, port in ports.items():
        table.add_row(device, port)
    Console().print(table)

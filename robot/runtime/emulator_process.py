"""The emulated rover as a process of its own, so that neither it nor the robot can hold the other up."""

from __future__ import annotations

import asyncio
import json
import sys
import tempfile
from asyncio.subprocess import DEVNULL, PIPE, Process
from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from robot.errors import UnavailableError

UP_S = 30.0
DOWN_S = 10.0
_PROGRAM = "from robot.cli import main; main()"


@dataclass(frozen=True, slots=True)
class EmulatorOptions:
    """What the emulated rover is told beyond the configuration file. ``zero_s`` is when its clock shows 0."""

    config_path: Path
    seed: int
    zero_s: float
    truth: Path | None = None
    faults: Sequence[str] = ()


@asynccontextmanager
async def emulator_process(options: EmulatorOptions) -> AsyncIterator[dict[str, str]]:
    """Start the emulated rover, give its map of ports (device -> stable path or address), take it down at the end.

    It ignores the keyboard's Ctrl-C, which is the robot's, and ends by itself when the robot's process dies, some
    seconds later, so that the truth of what valve and wheels then did is kept. ``UnavailableError`` when it does not
    come up.
    """
    with tempfile.TemporaryDirectory(prefix="sprayer-emulated-") as folder:
        arguments = ["emulate", "--config", str(options.config_path), "--json", "--links", folder, "--with-parent"]
        arguments += ["--seed", str(options.seed), "--zero", repr(options.zero_s)]
        if options.truth is not None:
            arguments += ["--truth", str(options.truth)]
        for fault in options.faults:
            arguments += ["--fault", fault]
        process = await asyncio.create_subprocess_exec(
            sys.executable, "-c", _PROGRAM, *arguments, stdin=DEVNULL, stdout=PIPE, start_new_session=True
        )
        try:
            ports = await _map_of(process)
            yield _stable(Path(folder), ports)
        finally:
            await _take_down(process)


def _stable(folder: Path, ports: dict[str, str]) -> dict[str, str]:
    """Names that outlive an unplugging, one for all devices on a port; an address is stable as it is."""
    links = {place: str(folder / name) for name, place in ports.items() if (folder / name).is_symlink()}
    return {name: links.get(place, place) for name, place in ports.items()}


async def _map_of(process: Process) -> dict[str, str]:
    assert process.stdout is not None
    try:
        async with asyncio.timeout(UP_S):
            line = await process.stdout.readline()
    except TimeoutError:
        line = b""
    if not line:
        raise UnavailableError(
            f"the emulated rover did not come up within {UP_S:g} s; its own message stands above; "
            "try it alone: sprayer emulate"
        )
    ports: dict[str, str] = json.loads(line)
    return ports


async def _take_down(process: Process) -> None:
    if process.returncode is None:
        with suppress(ProcessLookupError):
            process.terminate()
    try:
        async with asyncio.timeout(DOWN_S):
            await process.wait()
    except TimeoutError:
        process.kill()
        await process.wait()

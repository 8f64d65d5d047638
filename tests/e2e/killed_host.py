"""A robot on the emulated rover, to be killed: ``python -m tests.e2e.killed_host FOLDER PORTS ZERO_S MODE``.

``PORTS`` is the emulator's map as JSON, ``ZERO_S`` when its clock shows 0, ``MODE`` is ``begin``, ``resume`` or
``wait`` (disarmed, until a signal). Prints ``up`` when it is up, then ``armed``, at its end ``ended STATE; CAUSES``.
"""

from __future__ import annotations

import asyncio
import json
import sys
from pathlib import Path

from robot.clock import RealClockLoop
from robot.config import load_config
from robot.events import Bus
from robot.package_files import packaged
from robot.runtime import ModeChanged, RunBegan, RunOptions, run_robot
from robot.safety import Mode

EMULATED = packaged("configs") / "emulated.toml"


async def life(folder: Path, ports: dict[str, str], mode: str) -> None:
    bus = Bus()
    heard = bus.subscribe(RunBegan, ModeChanged)

    async def tell() -> None:
        async for event in heard:
            if isinstance(event, RunBegan):
                say("up")
            elif isinstance(event, ModeChanged) and event.mode is Mode.AUTO:
                say("armed")

    telling = asyncio.create_task(tell())
    options = RunOptions(EMULATED, folder, mode != "wait", mode == "resume", None, ports)
    result = await run_robot(load_config(EMULATED), options, bus)
    telling.cancel()
    say(f"ended {result.state}; {'; '.join(result.causes)}")


def say(words: str) -> None:
    sys.stdout.write(words + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    folder, ports, zero_s, mode = sys.argv[1:]
    with asyncio.Runner(loop_factory=lambda: RealClockLoop(float(zero_s))) as runner:
        runner.run(life(Path(folder), json.loads(ports), mode))

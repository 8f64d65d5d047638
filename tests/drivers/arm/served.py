"""Emulated servos in a process of their own, paced at the baud rate, until their standard input ends."""

from __future__ import annotations

import asyncio
import selectors
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from drivers.arm.emulator import DynamixelEmulator
from drivers.arm.joints import JointSettings, ServoSettings
from drivers.emulation.bad_line import BadLine
from drivers.emulation.wire import PtyWire
from drivers.twin import Twin
from tests.drivers.twin import rig

ROOT = Path(__file__).parents[3]


@contextmanager
def served(baud: int = 1_000_000, *options: str) -> Iterator[str]:
    """The path of their port. Options: "six" (one servo a joint), "cold" (no torque), "twice" (two with the id 3)."""
    command = [sys.executable, "-m", "tests.drivers.arm.served", str(baud), *options]
    process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, cwd=ROOT)
    try:
        assert process.stdout is not None
        yield process.stdout.readline().strip()
    finally:
        process.communicate()


def six_joints(twin: Twin) -> tuple[JointSettings, ...]:
    """One servo a joint, ids 1 to 6."""
    return tuple(
        JointSettings(joint.name, (ServoSettings(k, "XM540-W270"),), joint.low_rad, joint.high_rad)
        for k, joint in enumerate(twin.physics.geometry.joints, start=1)
    )


async def _serve(baud: int, options: list[str]) -> None:
    loop = asyncio.get_running_loop()
    zero_s = loop.time()

    def clock() -> float:
        return loop.time() - zero_s

    twin = rig.twin()
    joints = six_joints(twin) if "six" in options else None
    emulator = DynamixelEmulator(twin, clock, joints, baud=baud, cold="cold" in options)
    if "twice" in options:
        emulator.add_twin_of(3)
    wire = PtyWire(baud, emulator.receive)
    emulator.connect(BadLine("arm", twin, clock, wire.send, wire.byte_s))
    wire.plug()
    sys.stdout.write(wire.path + "\n")
    sys.stdout.flush()
    ended = asyncio.Event()
    loop.add_reader(sys.stdin.fileno(), ended.set)
    serving = asyncio.ensure_future(emulator.serve())
    await ended.wait()
    serving.cancel()
    await asyncio.wait({serving})


def main() -> None:
    with asyncio.Runner(loop_factory=lambda: asyncio.SelectorEventLoop(selectors.SelectSelector())) as runner:
        runner.run(_serve(int(sys.argv[1]), sys.argv[2:]))


if __name__ == "__main__":
    main()

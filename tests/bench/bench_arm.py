"""How near the arm's bus comes to its wire, and what following a trajectory costs.

The emulated servos run in a process of their own, paced at the baud rate; the driver's time is all its own.
"""

from __future__ import annotations

import asyncio
import json
import math
import selectors
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from drivers.arm import register_blocks as blocks
from drivers.arm.dynamixel import DynamixelArm
from drivers.arm.emulator import DynamixelEmulator
from drivers.arm.joints import DynamixelSettings, JointSettings, ServoSettings
from drivers.arm.servo_line import ServoLine
from drivers.arm.values import JointTrajectory
from drivers.emulation.bad_line import BadLine
from drivers.emulation.wire import PtyWire
from drivers.line import Line, PortSettings
from drivers.serial_port import SerialPort
from drivers.twin import Twin
from tests.drivers.twin import rig

BAUDS = (57_600, 1_000_000, 4_000_000)
CYCLES = {57_600: 40, 1_000_000: 600, 4_000_000: 600}
FOLLOW_S = 10.0
# bytes: sync write of six goals, sync read of six positions, six status packets with a position each
CYCLE_BYTES = (14 + 6 * 5) + (14 + 6) + 6 * 15
Line_ = Callable[[str, str, str], None]


def six_joints(twin: Twin) -> tuple[JointSettings, ...]:
    return tuple(
        JointSettings(joint.name, (ServoSettings(k, "XM540-W270"),), joint.low_rad, joint.high_rad)
        for k, joint in enumerate(twin.physics.geometry.joints, start=1)
    )


def serve(baud: int) -> None:
    """The emulated servos, until standard input ends."""

    async def main() -> None:
        twin = rig.twin()
        loop = asyncio.get_running_loop()
        clock = loop.time
        begun_s = clock()
        emulator = DynamixelEmulator(twin, lambda: clock() - begun_s, six_joints(twin), baud=baud)
        wire = PtyWire(baud, emulator.receive)
        emulator.connect(BadLine("arm", twin, lambda: clock() - begun_s, wire.send, wire.byte_s))
        wire.plug()
        sys.stdout.write(json.dumps({"arm": wire.path}) + "\n")
        sys.stdout.flush()
        ended = asyncio.Event()
        loop.add_reader(sys.stdin.fileno(), ended.set)
        serving = asyncio.ensure_future(emulator.serve())
        await ended.wait()
        serving.cancel()

    with asyncio.Runner(loop_factory=lambda: asyncio.SelectorEventLoop(selectors.SelectSelector())) as runner:
        runner.run(main())


@contextmanager
def emulated(baud: int) -> Iterator[str]:
    command = [sys.executable, "-m", "tests.bench.bench_arm", str(baud)]
    process = subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, cwd=Path(__file__).parents[2], text=True
    )
    try:
        assert process.stdout is not None
        yield str(json.loads(process.stdout.readline())["arm"])
    finally:
        process.communicate()


def settings_of(twin: Twin) -> DynamixelSettings:
    return DynamixelSettings(
        joints=six_joints(twin),
        max_velocity_rad_s=twin.nominal.joint_velocity_rad_s,
        max_acceleration_rad_s2=twin.nominal.joint_acceleration_rad_s2,
        watchdog_s=0.5,
    )


def cycle_times_s(path: str, baud: int) -> list[float]:
    """Goals of six servos out, their positions in, again and again, in the port's own thread."""
    times = []

    def job(line: Line) -> None:
        servos, ids = ServoLine(line), list(range(1, 7))
        for _ in range(CYCLES[baud]):
            began_s = time.monotonic()
            servos.sync_write(blocks.GOAL_ADDRESS, dict.fromkeys(ids, blocks.int32(2048)))
            answers = servos.sync_read(blocks.POSITION_ADDRESS, blocks.POSITION_BYTES, ids)
            if not answers.missing:
                times.append(time.monotonic() - began_s)

    async def main() -> None:
        port = SerialPort(PortSettings(path, "arm", baud, "dynamixel"), asyncio.get_running_loop().time)
        await port.attach("bench", lambda line: None)
        await port.run(job)
        await port.detach("bench")

    asyncio.run(main())
    return times


def cpu_share_of_following(path: str) -> tuple[float, float]:
    """Share of a core, and the mean cycle (s), while a trajectory is followed at 100 Hz."""
    twin = rig.twin()

    async def main() -> tuple[float, float]:
        port = SerialPort(PortSettings(path, "arm", 1_000_000, "dynamixel"), asyncio.get_running_loop().time)
        arm = DynamixelArm(settings_of(twin), port, asyncio.get_running_loop().time)
        await arm.open()
        start = (await arm.state()).position_rad
        times = tuple(0.02 * k for k in range(round(FOLLOW_S / 0.02) + 1))
        swing = JointTrajectory(
            times, tuple(tuple(q + 0.2 * (1 - math.cos(t)) for q in start) for t in times)
        )
        cpu_s, wall_s = time.process_time(), time.monotonic()
        await arm.follow(swing)
        share = (time.process_time() - cpu_s) / (time.monotonic() - wall_s)
        cycle_s = arm.diagnostics().cycle_mean_s
        await arm.close()
        return share, cycle_s

    return asyncio.run(main())


def bench(line: Line_) -> None:
    """One line a figure, through ``line(name, figures, goal)``."""
    for baud in BAUDS:
        limit_s = CYCLE_BYTES * 10 / baud
        with emulated(baud) as path:
            median_s = statistics.median(cycle_times_s(path, baud))
        figures = f"median {1e3 * median_s:6.3f} ms   wire {1e3 * limit_s:6.3f} ms   {median_s / limit_s:.2f} times"
        line(f"arm: six servos read and set, {baud} baud", figures, "<= 1.3 times" if baud == 1_000_000 else "")
    with emulated(1_000_000) as path:
        share, cycle_s = cpu_share_of_following(path)
    line("arm: following at 100 Hz, 1 Mbaud", f"{100 * share:.1f} % of a core   cycle {1e3 * cycle_s:.2f} ms", "<= 5 %")


def main() -> None:
    if len(sys.argv) > 1:
        serve(int(sys.argv[1]))
        return

    def say(name: str, figures: str, goal: str = "") -> None:
        sys.stdout.write(f"{name:<46}{figures}{'   goal ' + goal if goal else ''}\n")

    bench(say)


if __name__ == "__main__":
    main()

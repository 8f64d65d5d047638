"""How near the arm's bus comes to its wire, and what following a trajectory costs.

The emulated servos run in a process of their own, paced at the baud rate; the time of this process is the driver's.
"""

from __future__ import annotations

import asyncio
import math
import statistics
import time

from drivers.arm import register_blocks as blocks
from drivers.arm.dynamixel import DynamixelArm
from drivers.arm.joints import DynamixelSettings
from drivers.arm.servo_line import ServoLine
from drivers.arm.values import JointTrajectory
from drivers.line import Line, PortSettings
from drivers.serial_port import SerialPort
from drivers.twin import Twin
from tests.bench.lines import Say, say
from tests.drivers.arm.served import served, six_joints
from tests.drivers.twin import rig

BAUDS = (57_600, 1_000_000, 4_000_000)
CYCLES = {57_600: 60, 1_000_000: 600, 4_000_000: 600}
FOLLOW_S = 10.0
# sync write of six goals, sync read of six positions, six answers of a position each
CYCLE_BYTES = (14 + 6 * 5) + (14 + 6) + 6 * 15


def bench(say: Say) -> None:
    """One line a figure, through ``say(name, figures, goal)``."""
    for baud in BAUDS:
        limit_s = CYCLE_BYTES * 10 / baud
        with served(baud, "six") as path:
            median_s = statistics.median(cycle_times_s(path, baud))
        figures = f"median {1e3 * median_s:6.3f} ms   wire {1e3 * limit_s:6.3f} ms   {median_s / limit_s:.2f} times"
        say(f"arm: six servos read and set, {baud} baud", figures, "<= 1.3 times" if baud == 1_000_000 else "")
    with served(1_000_000, "six") as path:
        share, cycle_s = cpu_share_of_following(path)
    say("arm: following at 100 Hz, 1 Mbaud", f"{100 * share:.1f} % of a core   cycle {1e3 * cycle_s:.2f} ms", "<= 5 %")


def cycle_times_s(path: str, baud: int) -> list[float]:
    """Goals of six servos out, their positions in, again and again, in the port's own thread."""
    times: list[float] = []

    def job(line: Line) -> None:
        servos, ids = ServoLine(line), list(range(1, 7))
        for _ in range(CYCLES[baud]):
            began_s = time.monotonic()
            servos.sync_write(blocks.GOAL_ADDRESS, dict.fromkeys(ids, blocks.int32(2048)), with_next=True)
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
    settings = _settings(rig.twin())

    async def main() -> tuple[float, float]:
        loop = asyncio.get_running_loop()
        port = SerialPort(PortSettings(path, "arm", 1_000_000, "dynamixel"), loop.time)
        arm = DynamixelArm(settings, port, loop.time)
        await arm.open()
        start = (await arm.state()).position_rad
        times = tuple(0.02 * k for k in range(round(FOLLOW_S / 0.02) + 1))
        swing = JointTrajectory(times, tuple(tuple(q + 0.2 * (1 - math.cos(t)) for q in start) for t in times))
        cpu_s, wall_s = time.process_time(), time.monotonic()
        await arm.follow(swing)
        share = (time.process_time() - cpu_s) / (time.monotonic() - wall_s)
        cycle_s = arm.diagnostics().cycle_mean_s
        await arm.close()
        return share, cycle_s

    return asyncio.run(main())


def _settings(twin: Twin) -> DynamixelSettings:
    return DynamixelSettings(
        joints=six_joints(twin),
        max_velocity_rad_s=twin.nominal.joint_velocity_rad_s,
        max_acceleration_rad_s2=twin.nominal.joint_acceleration_rad_s2,
        watchdog_s=0.5,
    )


def main() -> None:
    bench(say)


if __name__ == "__main__":
    main()

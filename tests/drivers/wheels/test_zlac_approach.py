"""The robot's own drive law on a drive that takes whole rpm only."""

from __future__ import annotations

import asyncio
import math

import pytest

from drivers.twin.commands import WorldPush
from robot import navigation
from robot.geometry import Pose2
from tests.contract.rigs.wheels import WheelsRig
from tests.drivers.wheels.bench import drive, now, run, speed_m_s, x_m

LIMITS = navigation.DriveLimits()
PATIENCE_S = 60.0


async def approach(bench: WheelsRig, start: Pose2, goal_x_m: float) -> int:
    """Drive as the mission does; how many commands it took."""
    reading = await bench.device.odometry()
    at = navigation.start(start, reading, bench.device.track_m)
    commanded_m_s, commands, end_s = 0.0, 0, now() + PATIENCE_S
    while True:
        reading = await bench.device.odometry()
        at = navigation.predict(at, reading)
        order = navigation.command(at.pose, goal_x_m, reading.speed_m_s, commanded_m_s, LIMITS)
        if order.arrived:
            await bench.device.stop()
            return commands
        assert now() < end_s, f"still at {at.pose.x_m:.4f} m"
        await bench.device.drive(order.speed_m_s, order.yaw_rate_rad_s)
        commanded_m_s, commands = order.speed_m_s, commands + 1
        await asyncio.sleep(LIMITS.period_s)


@pytest.mark.parametrize("goal_m", [1.0, 0.25, 0.02, -0.3])
def test_an_approach_ends_within_a_centimetre(goal_m: float) -> None:
    async def test(bench: WheelsRig) -> None:
        await approach(bench, Pose2(0.0, 0.0, 0.0), goal_m)
        await asyncio.sleep(1.0)
        assert speed_m_s(bench) == 0.0
        assert x_m(bench) == pytest.approx(goal_m, abs=0.010)

    run(test)


def test_the_last_centimetres_are_made_slower_than_one_rpm() -> None:
    async def test(bench: WheelsRig) -> None:
        begun_s = now()
        await drive(bench, 10.0, 0.004)
        assert x_m(bench) / (now() - begun_s) == pytest.approx(0.004, rel=0.2)

    run(test)


def test_a_slow_curve_is_driven_as_commanded() -> None:
    async def test(bench: WheelsRig) -> None:
        begun_s = now()
        await drive(bench, 10.0, 0.05, 0.01)
        assert bench.twin.base_pose[2] / (now() - begun_s) == pytest.approx(0.01, rel=0.2)

    run(test)


def test_a_base_beside_its_lane_comes_back_to_it() -> None:
    async def test(bench: WheelsRig) -> None:
        bench.twin.apply(now(), WorldPush(0.0, 0.04, 0.0))
        await approach(bench, Pose2(0.0, 0.04, 0.0), 2.0)
        _, y_m, heading_rad = bench.twin.base_pose
        assert abs(y_m) < 0.01
        assert abs(heading_rad) < math.radians(1.5)

    run(test)

"""What every drive keeps, judged by where the base of the twin truly is."""

from __future__ import annotations

import asyncio
import math

import pytest

from drivers.errors import DeviceFault, DeviceLost, DeviceMissing, DeviceRefused, DeviceTimeout
from drivers.twin import Twin
from drivers.wheels.interface import Wheels
from tests.contract.conftest import Bench

SPEED = 0.2


def now() -> float:
    return asyncio.get_running_loop().time()


async def drive(wheels: Wheels, seconds: float, speed_m_s: float = SPEED, yaw_rate_rad_s: float = 0.0) -> None:
    """Renew a command at 20 Hz."""
    end_s = now() + seconds
    while now() < end_s:
        await wheels.drive(speed_m_s, yaw_rate_rad_s)
        await asyncio.sleep(0.05)


def travelled_m(twin: Twin) -> float:
    twin.advance(now())
    return math.hypot(twin.base_pose[0], twin.base_pose[1])


def test_opening_moves_nothing(wheels: Bench[Wheels]) -> None:
    async def test(device: Wheels, twin: Twin) -> None:
        await asyncio.sleep(2.0)
        assert travelled_m(twin) == 0.0

    wheels.run(test)


def test_forward_is_along_x(wheels: Bench[Wheels]) -> None:
    async def test(device: Wheels, twin: Twin) -> None:
        await drive(device, 3.0)
        x_m, y_m, _ = twin.base_pose
        assert 0.45 < x_m < 0.6
        assert abs(y_m) < 0.01

    wheels.run(test)


def test_positive_yaw_rate_turns_left(wheels: Bench[Wheels]) -> None:
    async def test(device: Wheels, twin: Twin) -> None:
        await drive(device, 2.0, 0.0, 0.5)
        assert 0.7 < twin.base_pose[2] < 1.1

    wheels.run(test)


def test_without_new_commands_the_base_stops_by_itself(wheels: Bench[Wheels]) -> None:
    async def test(device: Wheels, twin: Twin) -> None:
        await drive(device, 2.0)
        await device.drive(SPEED, 0.0)
        at_silence_m = travelled_m(twin)
        await asyncio.sleep(10.0)
        gone_m = travelled_m(twin) - at_silence_m
        braking_m = SPEED**2 / (2 * twin.nominal.max_acceleration_m_s2)
        assert gone_m <= SPEED * device.command_timeout_s + braking_m
        odometry = await device.odometry()
        assert odometry.speed_m_s == 0.0

    wheels.run(test)


def test_the_base_goes_on_while_commands_are_renewed_in_time(wheels: Bench[Wheels]) -> None:
    async def test(device: Wheels, twin: Twin) -> None:
        for _ in range(10):
            await device.drive(SPEED, 0.0)
            await asyncio.sleep(0.7 * device.command_timeout_s)
        assert (await device.odometry()).speed_m_s == pytest.approx(SPEED, abs=0.01)

    wheels.run(test)


def test_stop_brakes_to_standstill(wheels: Bench[Wheels]) -> None:
    async def test(device: Wheels, twin: Twin) -> None:
        await drive(device, 2.0)
        before_m = travelled_m(twin)
        await device.stop()
        await asyncio.sleep(1.0)
        stopped_m = travelled_m(twin)
        assert stopped_m - before_m < 0.06
        await asyncio.sleep(5.0)
        assert travelled_m(twin) == stopped_m

    wheels.run(test)


def test_odometry_counts_what_the_wheels_roll(wheels: Bench[Wheels]) -> None:
    async def test(device: Wheels, twin: Twin) -> None:
        await drive(device, 5.0)
        await device.stop()
        await asyncio.sleep(1.0)
        odometry = await device.odometry()
        true_m = travelled_m(twin)
        assert 0.5 * (odometry.left_m + odometry.right_m) == pytest.approx(true_m, rel=0.02)
        assert 0.0 <= now() - odometry.stamp_s < 0.5

    wheels.run(test)


def test_a_turn_on_the_spot_rolls_the_wheels_against_each_other(wheels: Bench[Wheels]) -> None:
    async def test(device: Wheels, twin: Twin) -> None:
        await drive(device, 2.0, 0.0, 0.4)
        await device.stop()
        await asyncio.sleep(1.0)
        odometry = await device.odometry()
        turned = (odometry.right_m - odometry.left_m) / device.track_m
        assert turned == pytest.approx(twin.base_pose[2], rel=0.02)

    wheels.run(test)


def test_counters_go_on_when_the_host_connects_anew(wheels: Bench[Wheels]) -> None:
    async def test(device: Wheels, twin: Twin) -> None:
        await drive(device, 2.0)
        await device.close()
        await asyncio.sleep(2.0)
        await device.open()
        assert (await device.odometry()).left_m == pytest.approx(travelled_m(twin), rel=0.02)

    wheels.run(test)


def test_closing_stops_the_base(wheels: Bench[Wheels]) -> None:
    async def test(device: Wheels, twin: Twin) -> None:
        await drive(device, 2.0)
        before_m = travelled_m(twin)
        await device.close()
        await asyncio.sleep(3.0)
        assert travelled_m(twin) - before_m < 0.06
        with pytest.raises(DeviceLost):
            await device.odometry()

    wheels.run(test)


@pytest.mark.parametrize("speeds", [(math.nan, 0.0), (0.0, math.inf)])
def test_speeds_that_are_no_numbers_are_refused(wheels: Bench[Wheels], speeds: tuple[float, float]) -> None:
    async def test(device: Wheels, twin: Twin) -> None:
        with pytest.raises(DeviceRefused):
            await device.drive(*speeds)

    wheels.run(test)


def test_a_drive_that_is_not_there_is_missing(wheels: Bench[Wheels]) -> None:
    async def test(device: Wheels, twin: Twin) -> None:
        with pytest.raises(DeviceMissing):
            await device.open()

    wheels.run(test, "wheels:off", opened=False)


def test_a_base_whose_bus_dies_stops_by_itself(wheels: Bench[Wheels]) -> None:
    async def test(device: Wheels, twin: Twin) -> None:
        with pytest.raises(DeviceTimeout):
            await drive(device, 5.0)
        await asyncio.sleep(2.0)
        rest_m = travelled_m(twin)
        await asyncio.sleep(2.0)
        assert travelled_m(twin) == rest_m < 0.4

    wheels.run(test, "wheels:off@1s")


def test_a_stuck_controller_keeps_its_speed_whatever_it_is_told(wheels: Bench[Wheels]) -> None:
    async def test(device: Wheels, twin: Twin) -> None:
        await drive(device, 2.0)
        await device.stop()
        before_m = travelled_m(twin)
        await asyncio.sleep(2.0)
        assert travelled_m(twin) - before_m == pytest.approx(2.0 * SPEED, rel=0.05)

    wheels.run(test, "wheels:stuck@1s")


def test_wrong_counters_count_too_much(wheels: Bench[Wheels]) -> None:
    async def test(device: Wheels, twin: Twin) -> None:
        await drive(device, 3.0)
        await device.stop()
        await asyncio.sleep(1.0)
        assert (await device.odometry()).left_m > 1.03 * travelled_m(twin)

    wheels.run(test, "wheels:wrong@1s")


def test_a_garbled_answer_is_a_fault(wheels: Bench[Wheels]) -> None:
    async def test(device: Wheels, twin: Twin) -> None:
        await asyncio.sleep(1.0)
        with pytest.raises(DeviceFault):
            await device.odometry()

    wheels.run(test, "wheels:garbage@1s")

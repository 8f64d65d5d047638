"""What every arm keeps, judged by the true joint angles of the twin."""

from __future__ import annotations

import asyncio
from collections.abc import Sequence

import numpy as np
import pytest

from drivers.arm.interface import Arm
from drivers.arm.values import JointTrajectory
from drivers.errors import DeviceError, DeviceFault, DeviceLost, DeviceMissing, DeviceRefused, DeviceTimeout
from drivers.twin import Twin
from drivers.twin import commands as c
from tests.contract.conftest import Bench
from tests.drivers.twin.rig import POINTING_RAD, STOW_RAD, quintic

ENCODER_RAD = 0.004  # quantum and noise of a reading
SETTLE_S = 0.5
MOVE_S = 2.2


def now() -> float:
    return asyncio.get_running_loop().time()


def move(start: tuple[float, ...] = STOW_RAD, goal: tuple[float, ...] = POINTING_RAD) -> JointTrajectory:
    times = [0.02 * k for k in range(round(MOVE_S / 0.02) + 1)]
    return JointTrajectory(tuple(times), tuple(quintic(start, goal, MOVE_S, t) for t in times))


def apart_rad(twin: Twin, angles: Sequence[float]) -> float:
    twin.advance(now())
    return float(np.abs(twin.joints_rad - np.asarray(angles)).max())


def test_opening_leaves_the_arm_where_it_is(arm: Bench[Arm]) -> None:
    async def test(device: Arm, twin: Twin) -> None:
        await asyncio.sleep(1.0)
        assert apart_rad(twin, STOW_RAD) < 1e-6

    arm.run(test)


def test_joints_are_named_from_the_base_outwards(arm: Bench[Arm]) -> None:
    async def test(device: Arm, twin: Twin) -> None:
        names = ("waist", "shoulder", "elbow", "forearm_roll", "wrist_angle", "wrist_rotate")
        assert device.joint_names == names
        state = await device.state()
        assert {len(t) for t in (state.position_rad, state.velocity_rad_s, state.load, state.hardware_error)} == {6}

    arm.run(test)


def test_state_tells_where_the_joints_are(arm: Bench[Arm]) -> None:
    async def test(device: Arm, twin: Twin) -> None:
        state = await device.state()
        assert np.abs(np.subtract(state.position_rad, STOW_RAD)).max() < ENCODER_RAD
        assert state.torque_on
        assert not any(state.hardware_error)
        assert 0.0 <= now() - state.stamp_s < 0.05

    arm.run(test)


def test_follow_returns_when_the_trajectorys_time_has_come(arm: Bench[Arm]) -> None:
    async def test(device: Arm, twin: Twin) -> None:
        start_s = now()
        await device.follow(move())
        assert MOVE_S <= now() - start_s < MOVE_S + 0.1

    arm.run(test)


def test_the_arm_settles_at_the_last_way_point(arm: Bench[Arm]) -> None:
    async def test(device: Arm, twin: Twin) -> None:
        await device.follow(move())
        await asyncio.sleep(SETTLE_S)
        assert apart_rad(twin, POINTING_RAD) < ENCODER_RAD

    arm.run(test)


def test_the_arm_keeps_to_the_trajectory_on_the_way(arm: Bench[Arm]) -> None:
    async def test(device: Arm, twin: Twin) -> None:
        following = asyncio.ensure_future(device.follow(move()))
        await asyncio.sleep(0.5)
        begun_s = now() - 0.5
        while not following.done():
            behind = apart_rad(twin, quintic(STOW_RAD, POINTING_RAD, MOVE_S, now() - begun_s))
            assert behind < 0.09  # first-order lag of a servo at full speed
            await asyncio.sleep(0.1)
        await following

    arm.run(test)


def test_a_far_first_way_point_is_refused_and_nothing_moves(arm: Bench[Arm]) -> None:
    async def test(device: Arm, twin: Twin) -> None:
        far = (STOW_RAD[0] + 0.12, *STOW_RAD[1:])
        with pytest.raises(DeviceRefused, match="waist"):
            await device.follow(move(start=far))
        await asyncio.sleep(1.0)
        assert apart_rad(twin, STOW_RAD) < 1e-6

    arm.run(test)


def test_a_first_way_point_a_little_off_is_taken(arm: Bench[Arm]) -> None:
    async def test(device: Arm, twin: Twin) -> None:
        await device.follow(move(start=(STOW_RAD[0] + 0.08, *STOW_RAD[1:])))
        await asyncio.sleep(SETTLE_S)
        assert apart_rad(twin, POINTING_RAD) < ENCODER_RAD

    arm.run(test)


def test_a_trajectory_for_another_arm_is_refused(arm: Bench[Arm]) -> None:
    async def test(device: Arm, twin: Twin) -> None:
        with pytest.raises(DeviceRefused, match="6 joint angles"):
            await device.follow(JointTrajectory((0.0,), ((0.0, 0.0),)))

    arm.run(test)


def test_a_trajectory_with_nan_is_refused(arm: Bench[Arm]) -> None:
    async def test(device: Arm, twin: Twin) -> None:
        with pytest.raises(DeviceRefused, match="finite"):
            await device.follow(JointTrajectory((0.0, 1.0), (STOW_RAD, (float("nan"),) * 6)))

    arm.run(test)


async def stopped_near(device: Arm, twin: Twin) -> None:
    """The arm brakes within what its limits need, stays there and keeps torque."""
    twin.advance(now())
    at_stop = twin.joints_rad
    state = await device.state()
    speed = np.abs(state.velocity_rad_s)
    needed = speed**2 / (2 * twin.nominal.joint_acceleration_rad_s2) + 0.05 * speed + ENCODER_RAD
    await asyncio.sleep(1.0)
    twin.advance(now())
    rest = twin.joints_rad
    assert (np.abs(rest - at_stop) <= needed).all()
    await asyncio.sleep(5.0)
    assert apart_rad(twin, tuple(rest)) < 1e-6
    assert (await device.state()).torque_on


def test_a_cancelled_follow_stops_where_it_is_and_holds(arm: Bench[Arm]) -> None:
    async def test(device: Arm, twin: Twin) -> None:
        following = asyncio.ensure_future(device.follow(move()))
        await asyncio.sleep(1.1)
        following.cancel()
        with pytest.raises(asyncio.CancelledError):
            await following
        await stopped_near(device, twin)
        assert apart_rad(twin, POINTING_RAD) > 0.2

    arm.run(test)


def test_hold_stops_a_running_trajectory(arm: Bench[Arm]) -> None:
    async def test(device: Arm, twin: Twin) -> None:
        following = asyncio.ensure_future(device.follow(move()))
        await asyncio.sleep(1.1)
        await device.hold()
        await stopped_near(device, twin)
        with pytest.raises(DeviceError):
            await following

    arm.run(test)


def test_hold_keeps_a_trajectory_that_is_just_beginning_from_moving(arm: Bench[Arm]) -> None:
    async def test(device: Arm, twin: Twin) -> None:
        following = asyncio.ensure_future(device.follow(move()))
        await asyncio.sleep(0.0)  # it has asked where the arm is, and has no answer yet
        await device.hold()
        with pytest.raises(DeviceError):
            await following
        await asyncio.sleep(1.0)
        assert apart_rad(twin, STOW_RAD) < 1e-6

    arm.run(test)


def test_hold_at_rest_moves_nothing(arm: Bench[Arm]) -> None:
    async def test(device: Arm, twin: Twin) -> None:
        await device.hold()
        await asyncio.sleep(2.0)
        assert apart_rad(twin, STOW_RAD) < 1e-6

    arm.run(test)


def test_two_trajectories_at_once_are_refused(arm: Bench[Arm]) -> None:
    async def test(device: Arm, twin: Twin) -> None:
        first = asyncio.ensure_future(device.follow(move()))
        await asyncio.sleep(0.5)
        with pytest.raises(DeviceRefused):
            await device.follow(move())
        await first

    arm.run(test)


def test_state_can_be_read_while_the_arm_moves(arm: Bench[Arm]) -> None:
    async def test(device: Arm, twin: Twin) -> None:
        following = asyncio.ensure_future(device.follow(move()))
        await asyncio.sleep(1.1)
        state = await device.state()
        assert max(np.abs(state.velocity_rad_s)) > 0.3
        await following

    arm.run(test)


def test_the_arm_keeps_holding_when_the_port_is_closed(arm: Bench[Arm]) -> None:
    async def test(device: Arm, twin: Twin) -> None:
        await device.close()
        await asyncio.sleep(60.0)
        assert apart_rad(twin, STOW_RAD) < 1e-6
        with pytest.raises(DeviceLost):
            await device.state()

    arm.run(test)


def test_without_torque_the_arm_sinks_and_does_not_follow(arm: Bench[Arm]) -> None:
    async def test(device: Arm, twin: Twin) -> None:
        await device.follow(move())
        height_m = twin.nozzle_pose[2, 3]
        await device.torque(False)
        await asyncio.sleep(3.0)
        state = await device.state()
        assert not state.torque_on
        assert twin.nozzle_pose[2, 3] < height_m - 0.02
        with pytest.raises(DeviceFault, match="torque off"):
            await device.follow(move(start=state.position_rad))

    arm.run(test)


def test_torque_on_holds_the_place_without_a_jump(arm: Bench[Arm]) -> None:
    async def test(device: Arm, twin: Twin) -> None:
        await device.torque(False)
        await asyncio.sleep(2.0)
        await device.torque(True)
        there = tuple(twin.joints_rad)
        await asyncio.sleep(2.0)
        assert apart_rad(twin, there) < ENCODER_RAD

    arm.run(test)


def test_a_servo_in_error_is_told_and_stops_the_trajectory(arm: Bench[Arm]) -> None:
    async def test(device: Arm, twin: Twin) -> None:
        following = asyncio.ensure_future(device.follow(move()))
        await asyncio.sleep(1.0)
        twin.apply(now(), c.WorldServoError(joint=2, error=0x20))
        with pytest.raises(DeviceFault, match="elbow reports 0x20"):
            await following
        assert (await device.state()).hardware_error == (0, 0, 0x20, 0, 0, 0)

    arm.run(test)


def test_an_absent_arm_is_missing(arm: Bench[Arm]) -> None:
    async def test(device: Arm, twin: Twin) -> None:
        with pytest.raises(DeviceMissing):
            await device.open()

    arm.run(test, "arm:off", opened=False)


def test_an_arm_whose_bus_dies_stops_by_itself(arm: Bench[Arm]) -> None:
    async def test(device: Arm, twin: Twin) -> None:
        with pytest.raises(DeviceTimeout):
            await device.follow(move())
        await asyncio.sleep(1.0)
        twin.advance(now())
        there = tuple(twin.joints_rad)
        await asyncio.sleep(3.0)
        assert apart_rad(twin, there) < 1e-6
        assert apart_rad(twin, POINTING_RAD) > 0.2

    arm.run(test, "arm:off@1s")


def test_a_garbled_answer_stops_the_trajectory(arm: Bench[Arm]) -> None:
    async def test(device: Arm, twin: Twin) -> None:
        with pytest.raises(DeviceFault, match="garbled"):
            await device.follow(move())
        await asyncio.sleep(1.0)
        await stopped_near(device, twin)
        assert apart_rad(twin, POINTING_RAD) > 0.2

    arm.run(test, "arm:garbage@1s+0.5s")


def test_a_jammed_arm_reads_the_same_wherever_it_is_sent(arm: Bench[Arm]) -> None:
    async def test(device: Arm, twin: Twin) -> None:
        await asyncio.sleep(0.5)
        await device.follow(move())
        assert apart_rad(twin, STOW_RAD) < 1e-6

    arm.run(test, "arm:stuck@0.1s")

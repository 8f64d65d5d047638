"""The Dynamixel driver where the contract of arms says nothing: servos that die, reboot, are cut off."""

from __future__ import annotations

import asyncio
import errno
import time
from dataclasses import replace

import numpy as np
import pytest

from drivers.arm.control_tables import TICK_RAD, OperatingMode
from drivers.arm.emulator import viperx300_joints
from drivers.arm.following import Follower
from drivers.arm.protocol2 import BROADCAST, Instruction, Packet, status
from drivers.errors import DeviceError, DeviceFault, DeviceLost, DeviceRefused, DeviceTimeout
from drivers.line import Line
from drivers.twin import commands as c
from tests.drivers.arm.rig import NUDGED_RAD, POINTING_RAD, STOW_RAD, ArmOnBus, apart_rad, move, nudge, on_bus, until
from tests.drivers.twin import rig

ACCELERATION_RAD_S2 = 4.0


def stopping_rad(speed_rad_s: np.ndarray) -> np.ndarray:
    """What the limits need, and the servos' lag."""
    return speed_rad_s**2 / (2 * ACCELERATION_RAD_S2) + 0.06 * speed_rad_s + 0.01


def test_the_watchdogs_are_armed_while_the_arm_is_open_and_disarmed_afterwards() -> None:
    async def test(bus: ArmOnBus) -> None:
        assert {bus.emulator.servo(i).get("bus_watchdog") for i in range(1, 9)} == {15}
        await asyncio.sleep(5.0)
        assert {bus.emulator.servo(i).get("bus_watchdog") for i in range(1, 9)} == {15}
        await bus.arm.close()
        assert {bus.emulator.servo(i).get("bus_watchdog") for i in range(1, 9)} == {0}

    on_bus(test, watchdog_s=0.3)


def test_an_arm_whose_host_dies_stops_by_its_watchdogs() -> None:
    async def test(bus: ArmOnBus) -> None:
        following = asyncio.ensure_future(bus.arm.follow(move()))
        await asyncio.sleep(1.1)
        before = bus.joints()
        bus.deaf = True  # nothing of the host reaches the servos any more, stops included
        with pytest.raises(DeviceError):
            await following
        await asyncio.sleep(1.5)
        there = bus.joints()
        assert {bus.emulator.servo(i).get("bus_watchdog") for i in range(1, 9)} == {-1}
        await asyncio.sleep(2.0)
        assert apart_rad(bus.joints(), there) < 1e-6
        assert apart_rad(there, POINTING_RAD) > 0.2
        assert apart_rad(there, before) < 0.8

    on_bus(test, watchdog_s=0.3)


def test_watchdogs_that_have_tripped_are_set_again_and_nothing_moves() -> None:
    async def test(bus: ArmOnBus) -> None:
        bus.deaf = True
        await asyncio.sleep(2.0)
        assert bus.emulator.servo(1).get("bus_watchdog") == -1
        before = bus.joints()
        bus.deaf = False
        await until(lambda: bus.emulator.servo(8).get("bus_watchdog") > 0)
        await asyncio.sleep(2.0)
        assert apart_rad(bus.joints(), before) < 0.003  # a tick, and the encoder's noise
        assert sum(servo.watchdog_trips for servo in bus.arm.diagnostics().servos) >= 8
        await bus.arm.follow(nudge())
        await asyncio.sleep(0.5)
        assert apart_rad(bus.joints(), NUDGED_RAD) < 0.004

    on_bus(test)


def test_an_arm_that_hears_nothing_of_the_program_brakes(monkeypatch: pytest.MonkeyPatch) -> None:
    async def test(bus: ArmOnBus) -> None:
        monkeypatch.setattr(Follower, "heartbeat", lambda self: None)  # as when the event loop hangs
        with pytest.raises(DeviceFault, match="to show that it lives"):
            await bus.arm.follow(move())
        await asyncio.sleep(1.0)
        there = bus.joints()
        await asyncio.sleep(2.0)
        assert apart_rad(bus.joints(), there) < 1e-6
        assert apart_rad(there, POINTING_RAD) > 0.2
        assert {bus.emulator.servo(i).get("bus_watchdog") for i in range(1, 9)} == {25}  # the driver braked, not they

    on_bus(test)


def test_a_rebooted_servo_is_noticed_until_the_arm_is_opened_again() -> None:
    async def test(bus: ArmOnBus) -> None:
        await asyncio.sleep(1.0)
        bus.emulator.reboot(7)
        await asyncio.sleep(1.5)
        for attempt in (bus.arm.state, lambda: bus.arm.follow(move()), lambda: bus.arm.torque(True)):
            with pytest.raises(DeviceFault, match=r"wrist_angle .* servo 7 rebooted"):
                await attempt()
        await bus.arm.open()
        assert not (await bus.arm.state()).torque_on
        await bus.arm.torque(True)
        assert (await bus.arm.state()).torque_on

    on_bus(test)


def test_a_watchdog_that_tripped_and_could_not_be_set_at_once_is_no_reboot() -> None:
    """A busy computer: nobody spoke to the servos for long, and one of the packets that set them anew was lost."""

    async def test(bus: ArmOnBus) -> None:
        lost: list[Packet] = []

        def loses(packet: Packet) -> bool:
            sets = packet.instruction == Instruction.WRITE and packet.data[:2] == b"\x62\0" and packet.data[2:] != b"\0"
            if sets and packet.servo_id == 5 and not lost:
                lost.append(packet)
                return True
            return False

        await asyncio.sleep(0.5)
        bus.loses = loses
        await bus.port.run(lambda line: time.sleep(0.6))
        await until(lambda: {bus.emulator.servo(i).get("bus_watchdog") for i in range(1, 9)} == {15})
        await asyncio.sleep(0.5)
        assert len(lost) == 1
        await bus.arm.state()
        bus.emulator.reboot(5)
        await asyncio.sleep(1.5)
        with pytest.raises(DeviceFault, match="servo 5 rebooted"):
            await bus.arm.state()

    on_bus(test, watchdog_s=0.3)


def test_a_servo_that_reboots_in_mid_motion_stops_the_others() -> None:
    async def test(bus: ArmOnBus) -> None:
        following = asyncio.ensure_future(bus.arm.follow(move()))
        await asyncio.sleep(1.1)
        bus.emulator.reboot(6)
        with pytest.raises(DeviceError, match=r"forearm_roll|torque off|servo 6"):
            await following
        await asyncio.sleep(1.0)
        there = bus.joints()
        await asyncio.sleep(2.0)
        assert apart_rad(bus.joints(), there) < 0.02  # the limp roll joint may creep
        assert apart_rad(there, POINTING_RAD) > 0.2

    on_bus(test)


def test_a_dead_servo_is_named_and_taken_back_when_it_answers_again() -> None:
    async def test(bus: ArmOnBus) -> None:
        bus.emulator.servo(4).dead = True
        await asyncio.sleep(2.0)
        with pytest.raises(DeviceTimeout, match=r"elbow \(servo 4\)"):
            await bus.arm.state()
        others = [servo for servo in bus.arm.diagnostics().servos if servo.servo_id != 4]
        assert all(servo.alive for servo in others)
        assert not bus.arm.diagnostics().servos[3].alive
        bus.emulator.servo(4).dead = False
        await until(lambda: bus.arm.diagnostics().servos[3].alive)
        assert (await bus.arm.state()).torque_on

    on_bus(test)


def test_after_eviction_a_dead_servo_is_asked_but_once_a_second() -> None:
    async def test(bus: ArmOnBus) -> None:
        bus.emulator.servo(4).dead = True
        await asyncio.sleep(2.0)
        bus.heard.clear()
        await asyncio.sleep(5.0)
        alone = [packet for packet in bus.heard if packet.servo_id == 4]
        together = [p for p in bus.heard if p.instruction == Instruction.SYNC_READ and 4 in p.data[4:]]
        assert 3 <= len(alone) <= 6
        assert not together

    on_bus(test)


def test_a_servo_that_dies_in_mid_motion_is_named_and_the_others_stop() -> None:
    async def test(bus: ArmOnBus) -> None:
        following = asyncio.ensure_future(bus.arm.follow(move()))
        await asyncio.sleep(1.1)
        bus.emulator.servo(1).dead = True  # the first in the chain of answers: nobody behind it answers either
        with pytest.raises(DeviceTimeout, match=r"waist \(servo 1\)"):
            await following
        at_stop = np.array(bus.joints())
        await asyncio.sleep(1.0)
        there = bus.joints()
        assert (np.abs(np.array(there) - at_stop) < stopping_rad(np.full(6, 1.5))).all()
        await asyncio.sleep(2.0)
        assert apart_rad(bus.joints(), there) < 1e-6

    on_bus(test)


def test_hold_stops_all_others_when_one_servo_is_dead_and_says_which() -> None:
    async def test(bus: ArmOnBus) -> None:
        following = asyncio.ensure_future(bus.arm.follow(move()))
        await asyncio.sleep(1.0)
        bus.emulator.servo(2).dead = True
        with pytest.raises(DeviceTimeout, match=r"shoulder \(servo 2\)"):
            await bus.arm.hold()
        await asyncio.wait({following})
        await asyncio.sleep(1.0)
        there = bus.joints()
        await asyncio.sleep(2.0)
        assert apart_rad(bus.joints(), there) < 1e-6
        assert apart_rad(there, POINTING_RAD) > 0.2

    on_bus(test)


def test_both_servos_of_a_joint_get_mirrored_goals() -> None:
    async def test(bus: ArmOnBus) -> None:
        await bus.arm.follow(nudge())
        for first, second in ((2, 3), (4, 5)):
            goals = [bus.emulator.servo(i).get("goal_position") - 2048 for i in (first, second)]
            assert goals[0] == -goals[1] != 0

    on_bus(test)


def test_a_hardware_error_of_a_shadow_servo_is_its_joints() -> None:
    async def test(bus: ArmOnBus) -> None:
        bus.emulator.servo(5).set("hardware_error_status", 0x04)
        assert (await bus.arm.state()).hardware_error == (0, 0, 0x04, 0, 0, 0)
        with pytest.raises(DeviceFault, match=r"elbow reports 0x04 \(overheating\)"):
            await bus.arm.follow(move())

    on_bus(test)


def test_torque_is_left_on_or_taken_off_as_the_policy_says() -> None:
    async def left_on(bus: ArmOnBus) -> None:
        await bus.arm.close()
        assert bus.twin.physics.servos.torque_on

    async def taken_off(bus: ArmOnBus) -> None:
        await bus.arm.close()
        assert not bus.twin.physics.servos.torque_on

    on_bus(left_on)
    on_bus(taken_off, torque_on_close="off")


def test_a_cold_arm_lies_in_its_cradle_and_takes_torque_without_a_jump() -> None:
    async def test(bus: ArmOnBus) -> None:
        await asyncio.sleep(10.0)
        assert bus.joints() == STOW_RAD
        assert not (await bus.arm.state()).torque_on
        await bus.arm.torque(True)
        await asyncio.sleep(1.0)
        assert apart_rad(bus.joints(), STOW_RAD) < 0.004
        await bus.arm.follow(nudge())
        await asyncio.sleep(0.5)
        assert apart_rad(bus.joints(), NUDGED_RAD) < 0.004

    on_bus(test, emulator={"cold": True})


def test_a_late_answer_is_not_taken_for_the_next() -> None:
    async def test(bus: ArmOnBus) -> None:
        answer = status(1, 0, (999_999).to_bytes(4, "little") * 2 + b"\0\0")
        bus.deaf = True
        asking = asyncio.ensure_future(bus.arm.state())
        await asyncio.sleep(0.05)
        bus.wire.send(answer, 0.02)
        with pytest.raises(DeviceError):
            await asking
        bus.deaf = False
        state = await bus.arm.state()
        assert apart_rad(state.position_rad, STOW_RAD) < 0.01

    on_bus(test)


def test_an_unplugged_arm_ends_a_trajectory_and_stops_by_itself() -> None:
    async def test(bus: ArmOnBus) -> None:
        following = asyncio.ensure_future(bus.arm.follow(move()))
        await asyncio.sleep(1.1)
        bus.wire.unplug()
        with pytest.raises(DeviceLost):
            await following
        with pytest.raises(DeviceLost):
            await bus.arm.state()
        await asyncio.sleep(1.0)
        there = bus.joints()
        await asyncio.sleep(2.0)
        assert apart_rad(bus.joints(), there) < 1e-6
        assert {bus.emulator.servo(i).get("bus_watchdog") for i in range(1, 9)} == {-1}

    on_bus(test)


def test_a_loss_that_another_job_meets_ends_the_trajectory_too() -> None:
    """The follower's own timers are gone with the port: it would never hear of it."""

    def fails(line: Line) -> None:
        raise OSError(errno.EIO, "Input/output error")

    async def test(bus: ArmOnBus) -> None:
        following = asyncio.ensure_future(bus.arm.follow(move()))
        await asyncio.sleep(1.1)
        with pytest.raises(DeviceLost):
            await bus.port.run(fails)
        with pytest.raises(DeviceLost):
            await asyncio.wait_for(following, 5.0)
        await asyncio.sleep(1.0)
        there = bus.joints()
        await asyncio.sleep(2.0)
        assert apart_rad(bus.joints(), there) < 0.003
        assert apart_rad(there, POINTING_RAD) > 0.2

    on_bus(test)


def test_an_arm_that_is_plugged_in_again_is_greeted_and_follows() -> None:
    async def test(bus: ArmOnBus) -> None:
        before = bus.joints()
        bus.wire.unplug()
        await asyncio.sleep(1.5)
        assert bus.emulator.servo(1).get("bus_watchdog") == -1
        bus.wire.plug()
        await until(lambda: bus.port.connected, 15.0)
        assert {bus.emulator.servo(i).get("bus_watchdog") for i in range(1, 9)} == {25}
        assert apart_rad(bus.joints(), before) < 0.004
        await bus.arm.follow(nudge())
        await asyncio.sleep(0.5)
        assert apart_rad(bus.joints(), NUDGED_RAD) < 0.004

    on_bus(test)


def test_a_servo_that_lost_its_power_while_the_port_was_gone_is_noticed() -> None:
    async def test(bus: ArmOnBus) -> None:
        bus.wire.unplug()
        await asyncio.sleep(0.5)
        bus.emulator.reboot(8)
        await asyncio.sleep(1.0)
        bus.wire.plug()
        await until(lambda: bus.port.connected, 15.0)
        with pytest.raises(DeviceFault, match="servo 8 rebooted"):
            await bus.arm.state()

    on_bus(test)


def test_in_position_mode_the_arm_follows_as_well() -> None:
    async def test(bus: ArmOnBus) -> None:
        await bus.arm.follow(nudge())
        await asyncio.sleep(0.5)
        assert apart_rad(bus.joints(), NUDGED_RAD) < 0.004

    mode = OperatingMode.POSITION
    on_bus(test, operating_mode=mode, emulator={"operating_mode": mode})


def test_a_slow_bus_is_followed_slowly() -> None:
    async def test(bus: ArmOnBus) -> None:
        await bus.arm.follow(move())
        await asyncio.sleep(1.0)
        assert apart_rad(bus.joints(), POINTING_RAD) < 0.004

    on_bus(test, "arm:slow@0.5s")


def test_on_a_bus_that_loses_every_other_answer_the_arm_arrives_or_stops() -> None:
    async def test(bus: ArmOnBus) -> None:
        try:
            await bus.arm.follow(move())
        except DeviceTimeout:
            await asyncio.sleep(1.5)
            there = bus.joints()
            await asyncio.sleep(2.0)
            assert apart_rad(bus.joints(), there) < 0.004
        else:
            await asyncio.sleep(0.5)
            assert apart_rad(bus.joints(), POINTING_RAD) < 0.004
        told = bus.arm.diagnostics()
        assert told.silences > 3

    on_bus(test, "arm:intermittent@1s+0.8s")


def test_a_trajectory_beyond_a_joints_limits_is_refused() -> None:
    async def test(bus: ArmOnBus) -> None:
        beyond = (*STOW_RAD[:4], 2.4, STOW_RAD[5])
        with pytest.raises(DeviceRefused, match="wrist_angle between"):
            await bus.arm.follow(move(goal=beyond))
        assert bus.joints() == STOW_RAD

    on_bus(test)


def test_a_trajectory_that_starts_elsewhere_is_refused_and_nothing_moves() -> None:
    async def test(bus: ArmOnBus) -> None:
        with pytest.raises(DeviceRefused, match=r"starts within 0.1 rad"):
            await bus.arm.follow(move(start=POINTING_RAD, goal=STOW_RAD))
        assert bus.joints() == STOW_RAD

    on_bus(test)


def test_a_stop_from_another_thread_stops_the_arm() -> None:
    async def test(bus: ArmOnBus) -> None:
        following = asyncio.ensure_future(bus.arm.follow(move()))
        await asyncio.sleep(1.1)
        await asyncio.to_thread(lambda: bus.arm.post_hold().result(5.0))
        with pytest.raises(DeviceFault, match="a stop meanwhile"):
            await following
        await asyncio.sleep(1.0)
        assert apart_rad(bus.joints(), POINTING_RAD) > 0.2

    on_bus(test)


def test_a_goal_whose_bytes_look_like_a_header_is_stuffed_and_taken() -> None:
    """Of -131073 they are FF FF FD FF; the waist's last way point is put there."""
    waist, *others = viperx300_joints(rig.twin())
    odd = replace(waist, servos=(replace(waist.servos[0], zero_tick=-131_073 - round(NUDGED_RAD[0] / TICK_RAD)),))

    async def test(bus: ArmOnBus) -> None:
        assert apart_rad((await bus.arm.state()).position_rad, STOW_RAD) < 0.004
        await bus.arm.follow(nudge())
        await asyncio.sleep(0.5)
        assert bus.emulator.servo(1).get("goal_position") == -131_073
        assert apart_rad(bus.joints(), NUDGED_RAD) < 0.004

    on_bus(test, emulator={"joints": (odd, *others)}, joints=(odd, *others))


def test_goals_go_out_at_a_hundred_a_second() -> None:
    async def test(bus: ArmOnBus) -> None:
        await bus.arm.follow(nudge())
        told = bus.arm.diagnostics()
        assert told.cycles > 30  # of 60: a loaded machine may lose some
        goals = [packet for packet in bus.heard if packet.instruction == Instruction.SYNC_WRITE]
        assert all(packet.servo_id == BROADCAST for packet in goals)
        assert len(goals) >= told.cycles

    on_bus(test)


def test_fast_sync_read_gives_the_same_state() -> None:
    async def test(bus: ArmOnBus) -> None:
        state = await bus.arm.state()
        assert apart_rad(state.position_rad, STOW_RAD) < 0.004
        await bus.arm.follow(nudge())
        await asyncio.sleep(0.5)
        assert apart_rad(bus.joints(), NUDGED_RAD) < 0.004
        assert [packet for packet in bus.heard if packet.instruction == Instruction.FAST_SYNC_READ]

    on_bus(test, fast_sync_read=True)


def test_diagnostics_tell_temperature_voltage_and_firmware() -> None:
    async def test(bus: ArmOnBus) -> None:
        await asyncio.sleep(2.0)
        for servo in bus.arm.diagnostics().servos:
            assert servo.firmware == 46
            assert servo.temperature_c is not None
            assert 20.0 <= servo.temperature_c <= 60.0
            assert servo.voltage_v is not None
            assert 11.0 <= servo.voltage_v <= 12.5

    on_bus(test)


def test_an_overloaded_servo_keeps_torque_off_and_torque_on_says_so() -> None:
    async def test(bus: ArmOnBus) -> None:
        bus.twin.apply(bus.now(), c.WorldServoError(joint=2, error=0x20))
        await asyncio.sleep(0.5)
        with pytest.raises(DeviceFault, match=r"torque on, found not so at elbow \(servo 4\)"):
            await bus.arm.torque(True)

    on_bus(test)


def test_opening_takes_little_time() -> None:
    async def test(bus: ArmOnBus) -> None:
        began_s, cpu_s = bus.now(), time.process_time()
        await bus.arm.open()
        assert bus.now() - began_s - (time.process_time() - cpu_s) < 3.0

    on_bus(test, opened=False)

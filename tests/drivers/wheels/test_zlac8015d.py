"""What the drive does beyond its contract, over an emulated controller."""

from __future__ import annotations

import asyncio
import math
import threading
from pathlib import Path
from typing import Any

import pytest

from drivers.errors import DeviceFault, DeviceLost, DeviceMissing, DeviceRefused, DeviceTimeout, WrongDevice
from drivers.modbus_master import ModbusLine
from drivers.wheels import zlac_registers as r
from drivers.wheels.drive_geometry import Mounting
from drivers.wheels.zlac_settings import Zlac8015dSettings
from tests.contract.rigs.wheels import WheelsRig
from tests.drivers.wheels.bench import drive, now, run, speed_m_s, x_m

SPEED = 0.2
MACHINE: dict[str, Any] = {"radius_m": 0.1, "track_m": 0.5, "max_speed_m_s": 0.5, "max_acceleration_m_s2": 0.5}


async def until(condition: Any, longest_s: float = 10.0) -> None:
    end_s = now() + longest_s
    while not condition():
        assert now() < end_s, "waited in vain"
        await asyncio.sleep(0.02)


# --- identity and settings ------------------------------------------------------------------------------------


def test_a_controller_with_another_id_is_missing_and_nothing_is_written() -> None:
    async def test(bench: WheelsRig) -> None:
        with pytest.raises(DeviceMissing, match=r"ZLAC8015D as unit 2.*silence"):
            await bench.device.open()
        assert set(bench.heard[1::8]) == {3}

    run(test, opened=False, unit_id=2)


def test_a_device_without_its_registers_is_a_wrong_one_and_is_not_written_to() -> None:
    async def test(bench: WheelsRig) -> None:
        with pytest.raises(WrongDevice, match="illegal data address"):
            await bench.device.open()
        assert set(bench.heard[1::8]) == {3}

    run(test, opened=False, lacks=frozenset({r.UNIT_ID.address}))


def test_a_firmware_without_the_offline_time_is_refused_with_the_reason() -> None:
    async def test(bench: WheelsRig) -> None:
        with pytest.raises(DeviceFault, match=r"0x2000 \(communication offline time.*illegal data address.*firmware"):
            await bench.device.open()
        with pytest.raises(DeviceLost):
            await bench.device.drive(SPEED, 0.0)

    run(test, opened=False, lacks=frozenset({r.OFFLINE_TIME.address}))


def test_opening_a_controller_with_an_old_command_moves_nothing() -> None:
    async def test(bench: WheelsRig) -> None:
        await drive(bench, 0.5, SPEED)
        await bench.master.detach("wheels")  # the host dies; the controller keeps its wanted speed until it times out
        bench.controller.preset_targets(20, -20)
        before_m = x_m(bench)
        await bench.device.open()
        await asyncio.sleep(2.0)
        assert x_m(bench) - before_m < 0.06

    run(test)


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"radius_m": 0.0}, "radius_m"),
        ({"track_m": -1.0}, "track_m"),
        ({"max_acceleration_m_s2": math.nan}, "max_acceleration_m_s2"),
        ({"command_timeout_s": 40.0}, "command_timeout_s"),
        ({"max_speed_m_s": 20.0}, "max_speed_m_s"),
        ({"max_acceleration_m_s2": 0.01}, "max_acceleration_m_s2"),
        ({"unit_id": 0}, "unit_id"),
    ],
)
def test_settings_that_the_controller_cannot_keep_are_refused(change: dict[str, float], named: str) -> None:
    with pytest.raises(ValueError, match=named):
        Zlac8015dSettings(**MACHINE | change)


def test_speeds_rise_as_the_settings_say_and_fall_twice_as_fast() -> None:
    async def test(bench: WheelsRig) -> None:
        await drive(bench, 0.3, 0.4)
        begun_s = now()
        before = speed_m_s(bench)
        await drive(bench, 0.3, 0.4)
        assert (speed_m_s(bench) - before) / (now() - begun_s) == pytest.approx(0.5, rel=0.05)
        await drive(bench, 1.0, 0.4)
        await bench.device.drive(0.0, 0.0)
        begun_s, before = now(), speed_m_s(bench)
        await asyncio.sleep(0.2)
        assert (before - speed_m_s(bench)) / (now() - begun_s) == pytest.approx(1.0, rel=0.1)

    run(test)


# --- time-outs ------------------------------------------------------------------------------------------------


def test_when_the_host_dies_the_controller_stops_the_base() -> None:
    async def test(bench: WheelsRig) -> None:
        await drive(bench, 2.0, SPEED)
        await bench.device.drive(SPEED, 0.0)
        before_m = x_m(bench)
        await bench.master.detach("wheels")  # nothing is said any more, not even 0
        spoken = len(bench.heard)
        await asyncio.sleep(5.0)
        assert speed_m_s(bench) == 0.0
        assert len(bench.heard) == spoken
        assert 0.05 < x_m(bench) - before_m <= SPEED * 0.5 + SPEED**2 / 2.0 + 0.01

    run(test)


def test_reading_on_does_not_keep_a_base_going_whose_commands_ceased() -> None:
    async def test(bench: WheelsRig) -> None:
        await drive(bench, 2.0, SPEED)
        end_s = now() + 1.5
        while now() < end_s:
            await bench.device.odometry()
            await asyncio.sleep(0.02)
        assert speed_m_s(bench) == 0.0

    run(test)


def test_a_base_that_could_not_be_halted_says_so_at_the_next_reading() -> None:
    async def test(bench: WheelsRig) -> None:
        await drive(bench, 1.0, SPEED)
        await asyncio.sleep(max(0.0, 4.0 - now()))
        with pytest.raises(DeviceTimeout):
            await bench.device.odometry()
        assert (await bench.device.odometry()).left_m_s == 0.0

    run(test, "wheels:off@1.1s+2.5s")


def test_a_short_command_time_out_is_the_controllers_too() -> None:
    async def test(bench: WheelsRig) -> None:
        assert bench.device.command_timeout_s == 0.2
        await drive(bench, 1.5, SPEED)
        before_m = x_m(bench)
        await bench.master.detach("wheels")
        await asyncio.sleep(3.0)
        assert x_m(bench) - before_m <= SPEED * 0.2 + SPEED**2 / 2.0 + 0.01

    run(test, command_timeout_s=0.2)


def test_after_a_lapse_the_next_command_drives_on() -> None:
    async def test(bench: WheelsRig) -> None:
        await drive(bench, 1.0, SPEED)
        await asyncio.sleep(3.0)
        assert speed_m_s(bench) == 0.0
        await drive(bench, 1.0, SPEED)
        assert speed_m_s(bench) == pytest.approx(SPEED, abs=0.02)

    run(test)


# --- stopping -------------------------------------------------------------------------------------------------


def test_a_drive_command_that_a_stop_overtook_is_not_sent() -> None:
    async def test(bench: WheelsRig) -> None:
        gate = threading.Event()

        def hold(line: ModbusLine) -> None:
            gate.wait(5.0)

        holding = asyncio.ensure_future(bench.master.run(hold))
        await asyncio.sleep(0.05)
        driving = asyncio.ensure_future(bench.device.drive(SPEED, 0.0))
        await asyncio.sleep(0.05)
        stopping = asyncio.ensure_future(bench.device.stop())
        await asyncio.sleep(0.05)
        gate.set()
        await asyncio.gather(holding, stopping)
        with pytest.raises(DeviceRefused, match="no stop since the command"):
            await driving
        await asyncio.sleep(1.0)
        assert x_m(bench) == 0.0

    run(test)


def test_a_drive_command_that_waited_too_long_is_not_sent() -> None:
    async def test(bench: WheelsRig) -> None:
        gate = threading.Event()

        def hold(line: ModbusLine) -> None:
            gate.wait(5.0)

        holding = asyncio.ensure_future(bench.master.run(hold))
        await asyncio.sleep(0.05)
        driving = asyncio.ensure_future(bench.device.drive(SPEED, 0.0))
        await asyncio.sleep(0.8)
        gate.set()
        await holding
        with pytest.raises(DeviceTimeout, match="busy"):
            await driving
        await asyncio.sleep(1.0)
        assert x_m(bench) == 0.0

    run(test)


def test_an_emergency_stop_brakes_and_the_next_command_leaves_it() -> None:
    async def test(bench: WheelsRig) -> None:
        await drive(bench, 2.0, SPEED)
        before_m = x_m(bench)
        await bench.device.emergency_stop()
        await asyncio.sleep(1.0)
        assert x_m(bench) - before_m < 0.06
        assert (await bench.device.diagnostics()).left.state == "emergency stop"
        await drive(bench, 1.0, SPEED)
        assert speed_m_s(bench) == pytest.approx(SPEED, abs=0.02)

    run(test)


def test_a_stop_that_no_one_acknowledges_is_a_time_out() -> None:
    async def test(bench: WheelsRig) -> None:
        await asyncio.sleep(1.0)
        with pytest.raises(DeviceTimeout):
            await bench.device.stop()

    run(test, "wheels:off@1s")


def test_a_stop_gets_through_a_line_that_loses_half_of_the_answers() -> None:
    async def test(bench: WheelsRig) -> None:
        for _ in range(3):
            await bench.device.drive(SPEED, 0.0)
            await asyncio.sleep(0.1)
        await asyncio.sleep(max(0.0, 1.0 - now()))
        lost = 0
        for _ in range(10):
            try:
                await bench.device.stop()
            except DeviceTimeout:
                lost += 1
        assert lost < 5
        assert speed_m_s(bench) == 0.0

    run(test, "wheels:intermittent@1s")


def test_a_base_that_does_not_come_to_a_stand_is_not_released() -> None:
    async def test(bench: WheelsRig) -> None:
        await drive(bench, 2.0, SPEED)
        with pytest.raises(DeviceFault, match="standstill"):
            await bench.device.close()
        assert bytes.fromhex("01 06 20 0E 00 07") not in bytes(bench.heard)

    run(test, "wheels:stuck@1s")


# --- faults and power -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("left", "right", "told"),
    [
        (0x0004, 0, r"over-current \(0x0004\) of the left wheel"),
        (0, 0x0200, r"Hall sensor \(0x0200\) of the right wheel"),
        (0x0020, 0x0400, r"encoder out of tolerance .* left wheel, motor over-temperature .* right wheel"),
    ],
)
def test_a_fault_is_named_with_its_wheel_and_remedy(left: int, right: int, told: str) -> None:
    async def test(bench: WheelsRig) -> None:
        bench.controller.raise_alarm(left, right)
        with pytest.raises(DeviceFault, match=told) as caught:
            await bench.device.odometry()
        assert "clear the alarm" in caught.value.remedy

    run(test)


def test_with_swapped_channels_a_fault_still_names_the_right_wheel() -> None:
    async def test(bench: WheelsRig) -> None:
        bench.controller.raise_alarm(left=0x0004)
        with pytest.raises(DeviceFault, match=r"over-current .* of the right wheel"):
            await bench.device.odometry()

    run(test, mounting=Mounting(swapped=True), swapped=True)


def test_a_fault_on_the_way_stops_the_base_and_refuses_to_start_again() -> None:
    async def test(bench: WheelsRig) -> None:
        await drive(bench, 2.0, SPEED)
        bench.controller.raise_alarm(right=0x0008)
        await bench.device.stop()
        with pytest.raises(DeviceFault, match="overload"):
            await bench.device.drive(SPEED, 0.0)
        await asyncio.sleep(1.0)
        assert speed_m_s(bench) == 0.0

    run(test)


def test_opening_does_not_clear_an_alarm() -> None:
    async def test(bench: WheelsRig) -> None:
        bench.controller.raise_alarm(left=0x0002)
        with pytest.raises(DeviceFault, match="under-voltage"):
            await bench.device.open()
        with pytest.raises(DeviceFault, match="under-voltage"):
            await bench.device.open()

    run(test, opened=False)


def test_an_alarm_is_cleared_on_request_and_the_base_drives_again() -> None:
    async def test(bench: WheelsRig) -> None:
        bench.controller.raise_alarm(left=0x0002)
        await bench.device.clear_alarm()
        await bench.device.odometry()
        assert x_m(bench) == 0.0
        await drive(bench, 1.0, SPEED)
        assert speed_m_s(bench) == pytest.approx(SPEED, abs=0.02)

    run(test)


def test_a_controller_that_lost_its_power_is_set_up_anew_before_it_drives() -> None:
    async def test(bench: WheelsRig) -> None:
        await drive(bench, 1.0, SPEED)
        await bench.device.stop()
        await asyncio.sleep(1.0)
        bench.controller.power_cycle()
        odometry = await bench.device.odometry()
        assert (odometry.left_m, odometry.right_m) == (0.0, 0.0)
        await drive(bench, 1.0, SPEED)
        assert speed_m_s(bench) == pytest.approx(SPEED, abs=0.02)
        await bench.master.detach("wheels")
        await asyncio.sleep(3.0)
        assert speed_m_s(bench) == 0.0  # its time-out was set again

    run(test)


def test_a_controller_that_loses_its_power_on_the_way_does_not_drive_on() -> None:
    async def test(bench: WheelsRig) -> None:
        await drive(bench, 1.0, SPEED)
        bench.controller.power_cycle()
        await drive(bench, 1.0, SPEED)
        assert speed_m_s(bench) == 0.0

    run(test)


def test_an_unplugged_controller_is_lost_and_comes_back_at_rest(tmp_path: Path) -> None:
    async def test(bench: WheelsRig) -> None:
        await drive(bench, 1.0, SPEED)
        bench.wire.unplug()
        with pytest.raises(DeviceLost):
            await bench.device.drive(SPEED, 0.0)
        await asyncio.sleep(2.0)
        bench.heard.clear()
        bench.wire.plug()
        await until(lambda: bench.port.connected)
        assert bytes.fromhex("01 10 20 88 00 02 04 00 00 00 00") in bytes(bench.heard)
        await asyncio.sleep(1.0)
        assert speed_m_s(bench) == 0.0
        assert (await bench.device.odometry()).left_m == pytest.approx(x_m(bench), rel=0.02)
        await drive(bench, 1.0, SPEED)
        assert speed_m_s(bench) == pytest.approx(SPEED, abs=0.02)

    run(test, link=tmp_path / "wheels")


def test_diagnostics_tell_supply_temperatures_and_states() -> None:
    async def test(bench: WheelsRig) -> None:
        await drive(bench, 1.0, SPEED)
        told = await bench.device.diagnostics()
        assert told.battery_v == pytest.approx(bench.twin.inputs(now()).battery_v, abs=0.2)
        assert 20.0 < told.controller_temperature_c < 60.0
        assert (told.left.state, told.right.state) == ("enabled", "enabled")
        assert told.left.turning
        assert told.right.turning
        assert told.left.counts_per_turn == 4096
        assert told.left.current_a > 0.0 > told.right.current_a  # the mirrored motor
        assert told.left.faults == ()
        assert told.software > 0

    run(test)


# --- odometry -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "mounting", [Mounting(), Mounting(True, False), Mounting(swapped=True), Mounting(True, True, True)]
)
def test_however_the_motors_sit_forward_is_forward_and_left_is_left(mounting: Mounting) -> None:
    async def test(bench: WheelsRig) -> None:
        await drive(bench, 1.0, 0.2, 0.4)
        await bench.device.stop()
        await asyncio.sleep(1.0)
        assert x_m(bench) > 0.05
        assert bench.twin.base_pose[2] > 0.1
        odometry = await bench.device.odometry()
        assert odometry.right_m > odometry.left_m > 0.0
        assert (odometry.right_m - odometry.left_m) / 0.5 == pytest.approx(bench.twin.base_pose[2], rel=0.03)

    run(
        test,
        mounting=mounting,
        left_mirrored=mounting.left_mirrored,
        right_mirrored=mounting.right_mirrored,
        swapped=mounting.swapped,
    )


def test_counters_that_wrap_go_on() -> None:
    async def test(bench: WheelsRig) -> None:
        bench.controller.preset_counters(2**31 - 200, -(2**31) + 200)
        before = await bench.device.odometry()
        await drive(bench, 2.0, SPEED)
        await bench.device.stop()
        await asyncio.sleep(1.0)
        after = await bench.device.odometry()
        assert after.left_m - before.left_m == pytest.approx(x_m(bench), rel=0.02)
        assert after.right_m - before.right_m == pytest.approx(x_m(bench), rel=0.02)

    run(test)


def test_speeds_are_those_of_the_wheels() -> None:
    async def test(bench: WheelsRig) -> None:
        await drive(bench, 2.0, 0.2, 0.2)
        odometry = await bench.device.odometry()
        assert odometry.left_m_s == pytest.approx(0.15, abs=0.015)
        assert odometry.right_m_s == pytest.approx(0.25, abs=0.015)

    run(test)

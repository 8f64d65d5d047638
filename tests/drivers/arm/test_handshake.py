"""What is wrong with the servos is named when the arm is opened, within 3 s, and nothing has been told to move."""

from __future__ import annotations

import asyncio
import re
import time

import pytest

from drivers.arm.control_tables import OperatingMode
from drivers.arm.emulator import DynamixelEmulator
from drivers.arm.protocol2 import Instruction
from drivers.emulation.wire import PtyWire
from drivers.errors import DeviceError, DeviceMissing, WrongDevice
from drivers.line import PortSettings
from drivers.serial_port import SerialPort
from tests.drivers.arm.rig import ArmOnBus, on_bus

WRITES = (Instruction.WRITE, Instruction.REG_WRITE, Instruction.SYNC_WRITE, Instruction.BULK_WRITE)
LONGEST_S = 3.0


async def refused(bus: ArmOnBus, kind: type[DeviceError], text: str) -> DeviceError:
    """Opening fails in time with this error, and no servo was written to."""
    began_s, cpu_s = bus.now(), time.process_time()
    with pytest.raises(kind, match=text) as caught:
        await bus.arm.open()
    waited_s = bus.now() - began_s - (time.process_time() - cpu_s)
    assert waited_s < LONGEST_S
    assert not [packet for packet in bus.heard if packet.instruction in WRITES]
    return caught.value


def test_a_missing_servo_is_named_with_all_others_beside_it() -> None:
    async def test(bus: ArmOnBus) -> None:
        bus.emulator.servo(4).dead = True
        error = await refused(bus, DeviceMissing, r"elbow \(servo 4\): no answer")
        rows = str(error).splitlines()
        assert len([row for row in rows if re.match(r"  \d", row)]) == 8
        assert any(re.search(r"4 +elbow +XM540-W270 .* - +- +- +-", row) for row in rows)
        assert any(re.search(r"8 +wrist_rotate +XM430-W350 .* XM430-W350 +46 +1000000", row) for row in rows)

    on_bus(test, opened=False)


def test_a_servo_with_another_id_is_found_where_one_is_missing() -> None:
    async def test(bus: ArmOnBus) -> None:
        bus.emulator.servo(6).set("id", 16)
        await refused(bus, DeviceMissing, r"forearm_roll \(servo 6\).*also there: servo 16 \(XM540-W270\)")

    on_bus(test, opened=False)


def test_an_unexpected_model_is_named() -> None:
    async def test(bus: ArmOnBus) -> None:
        bus.emulator.exchange(7, "XL430-W250")
        await refused(bus, WrongDevice, r"wrist_angle \(servo 7\): is an XL430-W250, not an XM540-W270")

    on_bus(test, opened=False)


def test_two_servos_with_one_id_are_noticed() -> None:
    async def test(bus: ArmOnBus) -> None:
        bus.emulator.add_twin_of(3)
        await refused(bus, WrongDevice, r"shoulder \(servo 3\).*two servos may have the id 3")

    on_bus(test, opened=False)


def test_two_servos_of_different_models_with_one_id_are_noticed() -> None:
    async def test(bus: ArmOnBus) -> None:
        bus.emulator.add_twin_of(1, "XM430-W210")
        await refused(bus, WrongDevice, r"waist \(servo 1\).*two servos may have the id 1")

    on_bus(test, opened=False)


def test_servos_at_another_baud_rate_are_found_there() -> None:
    def prepare(emulator: DynamixelEmulator) -> None:
        for servo_id in range(1, 9):
            emulator.servo(servo_id).set("baud_rate", 1)

    async def test(bus: ArmOnBus) -> None:
        await refused(bus, WrongDevice, r"at 1000000 baud, found them at 57600 baud; set arm.baud = 57600")

    on_bus(test, opened=False, prepare=prepare)


def test_one_servo_at_another_baud_rate_is_found_there() -> None:
    async def test(bus: ArmOnBus) -> None:
        bus.emulator.servo(8).set("baud_rate", 4)
        await refused(bus, WrongDevice, r"wrist_rotate \(servo 8\): answers at 2000000 baud")

    on_bus(test, opened=False)


def test_silence_at_every_rate_is_a_missing_arm() -> None:
    async def test(bus: ArmOnBus) -> None:
        bus.deaf = True
        await refused(bus, DeviceMissing, "silence at every baud")

    on_bus(test, opened=False)


@pytest.mark.parametrize(
    ("register", "value", "text"),
    [
        ("operating_mode", OperatingMode.POSITION, "operating_mode is 3, not 4"),
        ("drive_mode", 8, "drive_mode is 8, not 0"),
        ("homing_offset", 100, "homing_offset is 100, not 0"),
        ("secondary_id", 2, "secondary_id is 2, not off"),
        ("status_return_level", 1, "status_return_level is 1, not 2"),
    ],
)
def test_a_servo_that_is_set_otherwise_is_named(register: str, value: int, text: str) -> None:
    async def test(bus: ArmOnBus) -> None:
        bus.emulator.servo(5).set(register, value)
        await refused(bus, WrongDevice, rf"elbow \(servo 5\): {re.escape(text)}")

    on_bus(test, opened=False)


def test_old_firmware_is_named_when_a_newer_one_is_asked_for() -> None:
    async def test(bus: ArmOnBus) -> None:
        bus.emulator.servo(2).set("firmware_version", 38)
        await refused(bus, WrongDevice, r"shoulder \(servo 2\): firmware 38 is older than 45")

    on_bus(test, opened=False, minimum_firmware=45)


def test_position_limits_narrower_than_the_joints_are_named() -> None:
    async def test(bus: ArmOnBus) -> None:
        bus.emulator.servo(2).set("min_position_limit", 1500)
        await refused(bus, WrongDevice, r"shoulder \(servo 2\): position limits are 1500 to 4095")

    on_bus(
        test,
        opened=False,
        operating_mode=OperatingMode.POSITION,
        emulator={"operating_mode": OperatingMode.POSITION},
    )


def test_a_return_delay_is_taken_away_when_torque_is_off() -> None:
    async def test(bus: ArmOnBus) -> None:
        bus.emulator.servo(6).set("return_delay_time", 250)
        await bus.arm.open()
        assert bus.emulator.servo(6).get("return_delay_time") == 0
        assert not bus.arm.diagnostics().notes

    on_bus(test, opened=False, emulator={"cold": True})


def test_a_return_delay_under_torque_is_told_and_left() -> None:
    async def test(bus: ArmOnBus) -> None:
        bus.emulator.servo(6).set("return_delay_time", 250)
        await bus.arm.open()
        assert bus.emulator.servo(6).get("return_delay_time") == 250
        assert bus.arm.diagnostics().notes == (
            "servo 6 answers 500 us late: set return_delay_time to 0 with its torque off",
        )

    on_bus(test, opened=False)


@pytest.mark.parametrize(
    "said", [b"$GPGGA,120000.00,,,,,0,00,,,M,,M,,*6C\r\n", b"\x01\x83\x02\xc0\xf1", b"\r\nERROR\r\n"]
)
def test_another_device_on_the_port_is_no_arm(said: bytes) -> None:
    async def test(bus: ArmOnBus) -> None:
        loop = asyncio.get_running_loop()
        other = PtyWire(115_200, lambda data: other.send(said))
        other.plug()
        bus.port.settings = PortSettings(other.path, "arm", 1_000_000, "dynamixel")
        loop.busy = lambda: bus.port.busy or bool(other.unread)  # type: ignore[attr-defined]
        with pytest.raises(WrongDevice, match="bytes that no Dynamixel sends"):
            await bus.arm.open()
        other.unplug()

    on_bus(test, opened=False)


def test_a_port_that_is_not_there_is_named() -> None:
    async def test(bus: ArmOnBus) -> None:
        bus.port.settings = PortSettings("/dev/serial/by-id/none", "arm", 1_000_000, "dynamixel")
        with pytest.raises(DeviceMissing, match="/dev/serial/by-id/none"):
            await bus.arm.open()

    on_bus(test, opened=False)


def test_opening_writes_no_goal_and_no_torque() -> None:
    async def test(bus: ArmOnBus) -> None:
        for packet in bus.heard:
            if packet.instruction in WRITES:
                assert int.from_bytes(packet.data[:2], "little") in (9, 98)  # return delay, bus watchdog

    on_bus(test)


def test_a_port_of_its_own_is_given_back_after_a_failed_opening() -> None:
    async def test(bus: ArmOnBus) -> None:
        bus.emulator.servo(4).dead = True
        with pytest.raises(DeviceError):
            await bus.arm.open()
        bus.emulator.servo(4).dead = False
        second = SerialPort(bus.port.settings, bus.now)
        await second.attach("other", lambda line: None)
        await second.detach("other")
        await bus.arm.open()
        assert (await bus.arm.state()).torque_on

    on_bus(test, opened=False)

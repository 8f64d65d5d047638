"""Looking for servos, into one, and torque by hand."""

from __future__ import annotations

import pytest

from drivers.arm.bring_up import FoundServo, known_bauds, read_registers, scan, set_torque
from drivers.errors import DeviceRefused, DeviceTimeout
from tests.drivers.arm.rig import ArmOnBus, on_bus


async def on_port(bus: ArmOnBus) -> None:
    await bus.port.attach("tool", lambda line: None)


def test_a_scan_lists_every_servo() -> None:
    async def test(bus: ArmOnBus) -> None:
        await on_port(bus)
        found = await bus.port.run(scan)
        assert found[0] == FoundServo(1, 1120, 46, 1_000_000)
        assert [(servo.servo_id, servo.model) for servo in found][-1] == (8, "XM430-W350")
        assert len(found) == 8
        await bus.port.detach("tool")

    on_bus(test, opened=False)


def test_a_scan_over_all_rates_finds_a_lost_servo() -> None:
    async def test(bus: ArmOnBus) -> None:
        bus.emulator.servo(5).set("baud_rate", 1)
        await on_port(bus)
        found = await bus.port.run(lambda line: scan(line, [4, 5], known_bauds()))
        assert {(servo.servo_id, servo.baud) for servo in found} == {(4, 1_000_000), (5, 57_600)}
        await bus.port.detach("tool")

    on_bus(test, opened=False)


def test_registers_are_read_by_name() -> None:
    async def test(bus: ArmOnBus) -> None:
        await on_port(bus)
        told = await bus.port.run(lambda line: read_registers(line, 8, ["model_number", "operating_mode"]))
        assert [(register.name, value) for register, value in told] == [("model_number", 1020), ("operating_mode", 4)]
        everything = await bus.port.run(lambda line: read_registers(line, 8))
        assert len(everything) > 50
        with pytest.raises(DeviceRefused, match=r"a register of the XM430-W350, found goal_torque"):
            await bus.port.run(lambda line: read_registers(line, 8, ["goal_torque"]))
        with pytest.raises(DeviceTimeout, match="servo 99"):
            await bus.port.run(lambda line: read_registers(line, 99))
        await bus.port.detach("tool")

    on_bus(test, opened=False)


def test_torque_by_hand_takes_the_place_as_goal_and_goes_on_past_a_dead_servo() -> None:
    async def test(bus: ArmOnBus) -> None:
        bus.emulator.servo(2).dead = True
        await on_port(bus)
        ids = list(range(1, 9))
        with pytest.raises(DeviceTimeout, match="servo 2"):
            await bus.port.run(lambda line: set_torque(line, ids, True))
        assert [bus.emulator.servo(i).torque_on for i in ids] == [i != 2 for i in ids]
        for servo_id in (1, 4, 8):
            servo = bus.emulator.servo(servo_id)
            assert abs(servo.get("goal_position") - servo.get("present_position")) <= 4
        with pytest.raises(DeviceTimeout, match="servo 2"):
            await bus.port.run(lambda line: set_torque(line, ids, False))
        assert not any(bus.emulator.servo(i).torque_on for i in ids)
        await bus.port.detach("tool")

    on_bus(test, opened=False, emulator={"cold": True})

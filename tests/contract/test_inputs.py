"""What the inputs keep, judged by the liquid of the twin and by what the world does to it."""

from __future__ import annotations

import asyncio

import pytest

from drivers.errors import DeviceFault, DeviceLost, DeviceMissing, DeviceTimeout
from drivers.inputs.interface import Inputs
from drivers.relay.values import Channel
from drivers.twin import Twin
from drivers.twin import commands as c
from tests.contract.conftest import Bench


def now() -> float:
    return asyncio.get_running_loop().time()


def pulse(twin: Twin, channel: Channel, duration_s: float) -> None:
    twin.apply(now(), c.RelayPulse(channel, duration_s, now()))


def test_a_machine_at_rest_reads_at_rest(inputs: Bench[Inputs]) -> None:
    async def test(device: Inputs, twin: Twin) -> None:
        state = await device.read()
        assert not state.estop_pressed
        assert not state.bumper_pressed
        assert state.flow_ml_s == state.flow_total_ml == 0.0
        assert state.pressure_bar < 0.1
        assert abs(state.roll_rad) < 0.02
        assert 20.0 < state.battery_v < 30.0
        assert 0.0 <= now() - state.stamp_s < 0.5

    inputs.run(test)


def test_the_estop_is_seen_pressed_and_released(inputs: Bench[Inputs]) -> None:
    async def test(device: Inputs, twin: Twin) -> None:
        twin.apply(now(), c.WorldEstop(True))
        assert (await device.read()).estop_pressed
        twin.apply(now(), c.WorldEstop(False))
        assert not (await device.read()).estop_pressed

    inputs.run(test)


def test_bumper_and_tilt_are_seen(inputs: Bench[Inputs]) -> None:
    async def test(device: Inputs, twin: Twin) -> None:
        twin.apply(now(), c.WorldBumper(True))
        twin.apply(now(), c.WorldTilt(0.2, -0.1))
        state = await device.read()
        assert state.bumper_pressed
        assert (state.roll_rad, state.pitch_rad) == pytest.approx((0.2, -0.1), abs=0.02)

    inputs.run(test)


def test_the_pump_builds_up_pressure(inputs: Bench[Inputs]) -> None:
    async def test(device: Inputs, twin: Twin) -> None:
        pulse(twin, Channel.PUMP, 20.0)
        await asyncio.sleep(10.0)
        assert (await device.read()).pressure_bar == pytest.approx(twin.nominal.pump_pressure_bar, rel=0.05)

    inputs.run(test)


def test_the_flow_meter_counts_what_leaves_the_nozzle(inputs: Bench[Inputs]) -> None:
    async def test(device: Inputs, twin: Twin) -> None:
        pulse(twin, Channel.PUMP, 20.0)
        await asyncio.sleep(5.0)
        pulse(twin, Channel.VALVE, 2.0)
        await asyncio.sleep(1.0)
        assert (await device.read()).flow_ml_s == pytest.approx(twin.nominal.nozzle_flow_ml_s, rel=0.1)
        await asyncio.sleep(2.0)
        state = await device.read()
        assert state.flow_ml_s == 0.0
        assert state.flow_total_ml == pytest.approx(twin.dispensed_ml, rel=0.03)
        assert twin.dispensed_ml > 20.0

    inputs.run(test)


def test_the_level_falls_by_what_was_sprayed(inputs: Bench[Inputs]) -> None:
    async def test(device: Inputs, twin: Twin) -> None:
        before_ml = (await device.read()).tank_level_ml
        pulse(twin, Channel.PUMP, 20.0)
        await asyncio.sleep(5.0)
        pulse(twin, Channel.VALVE, 15.0)
        await asyncio.sleep(16.0)
        fallen_ml = before_ml - (await device.read()).tank_level_ml
        assert fallen_ml == pytest.approx(twin.dispensed_ml, abs=0.3 * twin.dispensed_ml)

    inputs.run(test, tank_ml=1000.0, tank_fill_ml=900.0)


def test_absent_inputs_are_missing(inputs: Bench[Inputs]) -> None:
    async def test(device: Inputs, twin: Twin) -> None:
        with pytest.raises(DeviceMissing):
            await device.open()

    inputs.run(test, "inputs:off", opened=False)


@pytest.mark.parametrize(("verb", "error"), [("off", DeviceTimeout), ("garbage", DeviceFault)])
def test_a_reading_that_does_not_come_is_an_error(inputs: Bench[Inputs], verb: str, error: type[Exception]) -> None:
    async def test(device: Inputs, twin: Twin) -> None:
        await asyncio.sleep(1.0)
        with pytest.raises(error):
            await device.read()

    inputs.run(test, f"inputs:{verb}@1s")


def test_closed_inputs_are_lost(inputs: Bench[Inputs]) -> None:
    async def test(device: Inputs, twin: Twin) -> None:
        await device.close()
        with pytest.raises(DeviceLost):
            await device.read()

    inputs.run(test)


def test_frozen_inputs_do_not_see_the_estop(inputs: Bench[Inputs]) -> None:
    async def test(device: Inputs, twin: Twin) -> None:
        await asyncio.sleep(1.0)
        first = await device.read()
        twin.apply(now(), c.WorldEstop(True))
        second = await device.read()
        assert not second.estop_pressed
        assert second.tank_level_ml == first.tank_level_ml
        assert second.stamp_s > first.stamp_s

    inputs.run(test, "inputs:stuck@1s")


def test_miscalibrated_inputs_read_too_much(inputs: Bench[Inputs]) -> None:
    async def test(device: Inputs, twin: Twin) -> None:
        await asyncio.sleep(1.0)
        assert (await device.read()).tank_level_ml > 1.1 * twin.nominal.tank_fill_ml

    inputs.run(test, "inputs:wrong@1s")

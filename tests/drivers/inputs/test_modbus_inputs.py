"""The inputs over the emulated modules of the reference rig, alone and beside the relay board on one bus."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Awaitable, Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from drivers.emulation.reference_bus import REFERENCE_BAUD, REFERENCE_WIRING, ReferenceBus
from drivers.errors import DeviceFault, DeviceLost, DeviceMissing, DeviceTimeout, WrongDevice
from drivers.inputs.modbus import InputsSettings, ModbusInputs
from drivers.inputs.profiles import analog_8, digital_8, inclinometer, reference_modules, reference_points
from drivers.line import PortSettings
from drivers.modbus_master import ModbusMaster
from drivers.relay.modbus import ModbusRelay, RelaySettings
from drivers.relay.values import Channel
from drivers.serial_port import SerialPort
from drivers.twin import commands as c
from tests.contract.leaping import LeapingLoop
from tests.drivers.relay.boards import Recorder, until
from tests.drivers.twin import rig


class Bench:
    """The reference bus with both its drivers."""

    def __init__(self, faults: tuple[str, ...], link: Path | None, modules: Any, first_count: int) -> None:
        loop = asyncio.get_running_loop()
        assert isinstance(loop, LeapingLoop)
        self.clock = loop.time
        self.twin = rig.twin(*faults)
        self.bus = ReferenceBus(self.twin, self.clock, link=link, first_count=first_count)
        self.bus.wire.plug()
        self.trace = Recorder()
        path = str(link or self.bus.wire.path)
        self.port = SerialPort(PortSettings(path, "bus", REFERENCE_BAUD, "modbus"), self.clock, trace=self.trace)  # type: ignore[arg-type]
        master = ModbusMaster(self.port)
        points = reference_points(self.twin.nominal.tank_ml, self.twin.nominal.flow_meter_pulses_per_l)
        self.inputs = ModbusInputs(InputsSettings(modules, points), master, self.clock)
        wired = {channel: REFERENCE_WIRING[channel] for channel in self.twin.nominal.channels}
        self.relay = ModbusRelay(RelaySettings("waveshare-8", 1, wired), master, self.clock)
        loop.busy = lambda: self.port.busy or bool(self.bus.wire.unread)


def on_bus(
    test: Callable[[Bench], Awaitable[None]],
    *faults: str,
    opened: bool = True,
    link: Path | None = None,
    modules: Any = None,
    first_count: int = 0,
) -> None:
    async def main() -> None:
        bench = Bench(faults, link, modules or reference_modules(), first_count)
        try:
            if opened:
                await bench.inputs.open()
            await test(bench)
        finally:
            for user in ("inputs", "relay"):
                await bench.port.detach(user)
            bench.bus.wire.unplug()

    with asyncio.Runner(loop_factory=LeapingLoop) as runner:
        runner.run(main())


@pytest.mark.parametrize("quantity", ["estop_pressed", "bumper_pressed"])
def test_a_cut_wire_of_a_contact_reads_pressed(quantity: str) -> None:
    async def test(bench: Bench) -> None:
        assert not getattr(await bench.inputs.read(), quantity)
        bench.bus.inputs.sampler.cut.add(quantity)
        assert getattr(await bench.inputs.read(), quantity)

    on_bus(test)


@pytest.mark.parametrize("quantity", ["tank_level_ml", "pressure_bar", "battery_v"])
def test_a_cut_wire_of_a_current_loop_is_a_fault_that_names_the_sensor(quantity: str) -> None:
    async def test(bench: Bench) -> None:
        bench.bus.inputs.sampler.cut.add(quantity)
        with pytest.raises(DeviceFault, match=f"{quantity}.*broken wire"):
            await bench.inputs.read()
        bench.bus.inputs.sampler.cut.clear()
        await bench.inputs.read()

    on_bus(test)


def test_the_flow_total_goes_on_over_the_end_of_the_counter() -> None:
    async def test(bench: Bench) -> None:
        before = await bench.inputs.read()
        bench.twin.apply(bench.clock(), c.RelayPulse(Channel.PUMP, 20.0, bench.clock()))
        await asyncio.sleep(5.0)
        bench.twin.apply(bench.clock(), c.RelayPulse(Channel.VALVE, 2.0, bench.clock()))
        await asyncio.sleep(3.0)
        passed_ml = (await bench.inputs.read()).flow_total_ml - before.flow_total_ml
        assert passed_ml == pytest.approx(bench.twin.dispensed_ml, rel=0.03)
        assert passed_ml > 20.0

    on_bus(test, first_count=(1 << 32) - 10)


def test_late_inputs_show_what_was_a_second_ago() -> None:
    async def test(bench: Bench) -> None:
        await asyncio.sleep(2.0)
        await bench.inputs.read()
        await asyncio.sleep(0.5)
        await bench.inputs.read()
        bench.twin.apply(bench.clock(), c.WorldEstop(True))
        assert not (await bench.inputs.read()).estop_pressed
        await asyncio.sleep(1.2)
        await bench.inputs.read()
        await asyncio.sleep(1.2)
        assert (await bench.inputs.read()).estop_pressed

    on_bus(test, "inputs:delayed@1s")


def test_readings_come_through_a_line_that_loses_half_of_the_answers() -> None:
    async def test(bench: Bench) -> None:
        await asyncio.sleep(1.0)
        failed = 0
        for _ in range(10):
            try:
                await bench.inputs.read()
            except DeviceTimeout:
                failed += 1
        assert failed < 10  # with one try a frame, four in a row would come through once in sixteen readings

    on_bus(test, "inputs:intermittent@1s")


def test_relay_and_inputs_share_the_bus() -> None:
    async def test(bench: Bench) -> None:
        await bench.relay.open()
        readings, receipt = await asyncio.gather(
            asyncio.gather(*(bench.inputs.read() for _ in range(5))), bench.relay.pulse(Channel.LAMP, 0.5)
        )
        assert len(readings) == 5
        assert bench.twin.coils(receipt.accepted_s)[Channel.LAMP]
        await bench.relay.close()
        await bench.inputs.read()

    on_bus(test)


def test_a_stop_waits_for_one_frame_of_a_dead_module_and_no_more() -> None:
    async def test(bench: Bench) -> None:
        await bench.relay.open()
        await asyncio.sleep(1.0 - bench.clock())
        await bench.relay.pulse(Channel.VALVE, 5.0)
        reading = asyncio.ensure_future(bench.inputs.read())
        await until(lambda: bench.trace.requests()[-1][0] != 1)
        sent = len(bench.trace.requests())
        await bench.relay.cancel(Channel.VALVE)
        assert not bench.twin.coils(bench.clock())[Channel.VALVE]
        assert bench.trace.requests()[sent] == bytes.fromhex("01 05 00 00 00 00 cd ca")
        assert not reading.done()
        with pytest.raises(DeviceTimeout):
            await reading

    on_bus(test, "inputs:off@1s")


def test_a_relay_board_that_stays_away_does_not_keep_the_inputs_from_coming_back(tmp_path: Path) -> None:
    async def test(bench: Bench) -> None:
        await bench.relay.open()
        await asyncio.sleep(2.0 - bench.clock())
        bench.bus.wire.unplug()
        with pytest.raises(DeviceLost):
            await bench.inputs.read()
        bench.bus.wire.plug()
        await until(lambda: bench.port.connected)
        assert not (await bench.inputs.read()).estop_pressed
        with pytest.raises(DeviceTimeout, match="relay"):
            await bench.relay.read()

    on_bus(test, "relay:off@1.5s", link=tmp_path / "bus")


def test_opening_ends_within_three_seconds_though_every_module_is_silent() -> None:
    async def test(bench: Bench) -> None:
        start_s = time.monotonic()
        with pytest.raises(DeviceMissing, match=r"Analog Input.*unit 2.*silence"):
            await bench.inputs.open()
        assert time.monotonic() - start_s < 3.0

    on_bus(test, "inputs:off", opened=False)


@pytest.mark.parametrize(
    ("modules", "why"),
    [
        ((analog_8(3), digital_8(2), inclinometer(80)), "the range 4 to 20 mA"),
        ((analog_8(2), digital_8(3), inclinometer(1)), "its own unit id at holding register 0x001a"),
        ((analog_8(1), digital_8(3), inclinometer(80)), "range 4 to 20 mA"),
    ],
)
def test_a_module_that_is_another_is_refused(modules: Any, why: str) -> None:
    async def test(bench: Bench) -> None:
        moved = {2: modules[0].unit_id, 3: modules[1].unit_id, 80: modules[2].unit_id}
        points = reference_points(10_000.0, 5880.0)
        settings = InputsSettings(modules, tuple(replace(point, unit_id=moved[point.unit_id]) for point in points))
        device = ModbusInputs(settings, ModbusMaster(bench.port), bench.clock)
        with pytest.raises(WrongDevice, match=why):
            await device.open()
        assert bench.trace.writes() == []

    on_bus(test, opened=False)

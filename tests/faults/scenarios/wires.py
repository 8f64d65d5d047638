"""Faults of bytes, at production drivers on emulated wires."""

from __future__ import annotations

import asyncio
import os
import pty
import time
from pathlib import Path
from unittest.mock import patch

import pytest

from drivers.emulation.bad_line import BadLine
from drivers.emulation.modbus_slave import DEVICE_FAILURE, ModbusException
from drivers.errors import DeviceError, DeviceTimeout
from drivers.modbus_frames import with_crc
from drivers.modbus_master import ModbusLine, ModbusRefusal
from drivers.relay.mock import MockRelay
from drivers.relay.values import Channel
from robot.safety.catalogue import Action
from tests.drivers.arm.rig import ArmOnBus, on_bus
from tests.drivers.modbus_bus import Bus, Memory, on_a_bus
from tests.drivers.relay.boards import Bench, on_board
from tests.drivers.test_modbus_master import Scripted
from tests.e2e.emulated import EMULATED, emulator, held, motions_in, orders_in, variables, written
from tests.robot.mission.conftest import SHORT
from tests.robot.mission.rover import spray_row

from .judging import judged
from .refusals import BUSY, UNAVAILABLE, refused
from .values import Scenarios, Seen, Stage


def noise(_stage: Stage) -> Seen:
    """An answer is garbled, the request made again, and the coils are read as they are."""
    seen: list[Seen] = []
    say, garbled = BadLine.say, 0

    def garble_the_first(line: BadLine, data: bytes, delay_s: float = 0.0, heard_bytes: int = 0) -> None:
        nonlocal garbled
        garbled += 1
        say(line, data if garbled > 1 else bytes([*data[:-1], data[-1] ^ 0x10]), delay_s, heard_bytes)

    async def test(bench: Bench) -> None:
        statistics = bench.master.statistics
        before, began_s = statistics.garbled, bench.clock()
        with patch.object(BadLine, "say", garble_the_first):
            state = await bench.relay.read()
        assert not any(state.coils.values())
        assert statistics.garbled == before + 1
        seen.append(Seen(Action.WARN, bench.clock() - began_s, "counts of bad frames"))

    on_board("waveshare-8", test)
    return seen[0]


def foreign_answer(_stage: Stage) -> Seen:
    """Another unit's answer on the bus is not believed; the next request has its own answer."""
    seen: list[Seen] = []

    async def test(bus: Bus) -> None:
        bus.slaves.add(1, Scripted(bus, with_crc(bytes([2, 3, 2, 0, 7]))), bus.line)
        began_s = time.process_time()
        with pytest.raises(DeviceError, match="of unit 2"):
            await bus.master.run(lambda line: line.unit("tank", 1).read_holding(0, 1))
        seen.append(Seen(Action.WARN, time.process_time() - began_s, "the count"))
        assert bus.master.statistics.garbled == 1

    on_a_bus(test)
    return seen[0]


def late_answer(_stage: Stage) -> Seen:
    """The answer to an earlier request comes while another is waited for."""
    seen: list[Seen] = []
    late, fresh = (with_crc(bytes([1, 3, 2, 0, value])) for value in (7, 8))

    async def test(bus: Bus) -> None:
        bus.slaves.add(1, Scripted(bus, late, delay_s=0.3), bus.line)

        def job(line: ModbusLine) -> list[int]:
            with pytest.raises(DeviceTimeout):
                line.unit("tank", 1, 0.25).read_holding(0, 1)
            bus.slaves.add(1, Scripted(bus, fresh, delay_s=0.15), bus.line)
            return line.unit("tank", 1, 0.25).read_holding(0, 1)

        began_s = time.process_time()
        assert await bus.master.run(job) == [8]
        seen.append(Seen(Action.WARN, time.process_time() - began_s, "the count"))
        assert bus.master.statistics.silent == 1

    on_a_bus(test)
    return seen[0]


class Refusing(Memory):
    """A board that reports a failure of its own (exception 4) for every coil."""

    def answer(self, function: int, data: bytes) -> bytes | None:
        raise ModbusException(DEVICE_FAILURE)


def exception_reply(stage: Stage) -> Seen:
    """The driver names the code; a board that answers so to an opening stops the machine, and the shot is booked."""
    refusals: list[ModbusRefusal] = []

    async def test(bus: Bus) -> None:
        with pytest.raises(ModbusRefusal, match="exception 4") as caught:
            await bus.master.run(lambda line: line.unit("relay", 1).write_coil(0, 0x0002))
        refusals.append(caught.value)

    on_a_bus(test, (1, Refusing()))
    moments: list[float] = []
    pulse = MockRelay.pulse

    async def refuse(relay: MockRelay, channel: Channel, duration_s: float):  # type: ignore[no-untyped-def]
        if channel is not Channel.VALVE:
            return await pulse(relay, channel, duration_s)
        moments.append(asyncio.get_running_loop().time())
        raise refusals[0]

    with patch.object(MockRelay, "pulse", refuse):
        run = spray_row(stage.folder, **SHORT)
    assert run.twin.dispensed_ml == 0.0
    return judged(run, moments[0], "the exception 4", kept="the exception's code; booked in full")


def torn_frames(_stage: Stage) -> Seen:
    """Garbled answers of the servos for a moment: the state comes by another try, and no joint moved."""
    seen: list[Seen] = []

    async def test(bus: ArmOnBus) -> None:
        before = bus.joints()
        await asyncio.sleep(3.0 - bus.now())
        began_s = bus.now()
        tries = 0
        while True:
            tries += 1
            try:
                state = await bus.arm.state()
                break
            except DeviceError:
                assert bus.now() - began_s < 1.0
        assert max(abs(a - b) for a, b in zip(state.position_rad, before, strict=True)) < 0.01
        seen.append(Seen(Action.WARN, bus.now() - began_s, f"the reading, at try {tries}"))

    on_bus(test, "arm:garbage@2.99s+0.02s")
    return seen[0]


def port_held(stage: Stage) -> Seen:
    """Another program has the relay board's port: the robot says which, and does not come up."""
    master, slave = pty.openpty()
    port = os.ttyname(slave)
    try:
        with held(port) as holder, pytest.MonkeyPatch.context() as environment:
            for name, value in variables({"relay": port}).items():
                environment.setenv(name, value)
            return refused(
                ["run", "--config", str(EMULATED), "--out", str(stage.folder / "out")], BUSY,
                port, f"process {holder} (", "stop that process first", kept="who holds it",
            )  # fmt: skip
    finally:
        os.close(master)
        os.close(slave)


def ports_swapped(stage: Stage) -> Seen:
    """The receiver stands at the relay board's port: told before anything is ordered there."""
    truth, trace = stage.folder / "truth.jsonl", stage.folder / "trace"
    with emulator("--only=gps", "--truth", str(truth)) as other, pytest.MonkeyPatch.context() as environment:
        for name, value in variables({"relay": other.ports["gps"]}).items():
            environment.setenv(name, value)
        seen = refused(
            ["run", "--config", str(EMULATED), "--out", str(stage.folder / "out"), "--trace", str(trace)],
            UNAVAILABLE, "relay: expected", kept="what answered", clock=time.monotonic,
        )  # fmt: skip
    assert orders_in(written(Path(trace) / "relay.trace.jsonl")) == []
    assert motions_in(truth) == []
    return seen


WIRES: Scenarios = {
    "F05": {"": noise},
    "F06": {"another unit's": foreign_answer, "an earlier one's": late_answer},
    "F07": {"": exception_reply},
    "F16": {"": torn_frames},
    "F23": {"": port_held},
    "F25": {"": ports_swapped},
}

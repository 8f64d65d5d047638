"""The Modbus master and a relay board over TCP: with the header of Modbus TCP, and RTU frames through a gateway."""

from __future__ import annotations

import asyncio
import socket
import threading
from collections.abc import Awaitable, Callable

import pytest

from drivers.emulation.bad_line import BadLine
from drivers.emulation.modbus_slave import ModbusSlaves, TcpSlaves
from drivers.emulation.tcp_wire import TcpWire
from drivers.errors import DeviceFault, DeviceLost, DeviceMissing, DeviceTimeout, WrongDevice
from drivers.line import PortSettings
from drivers.modbus_master import ModbusMaster
from drivers.relay.emulator import emulated_board
from drivers.relay.modbus import ModbusRelay, RelaySettings
from drivers.relay.values import Channel
from drivers.serial_port import SerialPort
from drivers.twin import Twin
from tests.drivers.modbus_bus import Memory, nothing
from tests.drivers.relay.boards import WIRED, until
from tests.drivers.twin import rig

Test = Callable[[ModbusRelay, Twin, TcpWire], Awaitable[None]]
SCHEMES = ["tcp", "rtu+tcp"]


def on_tcp(scheme: str, test: Test, *faults: str, opened: bool = True) -> None:
    async def main() -> None:
        loop = asyncio.get_running_loop()
        zero_s = loop.time()

        def clock() -> float:
            return loop.time() - zero_s

        twin = rig.twin(*faults)
        baud = 0 if scheme == "tcp" else 9600
        byte_s = 10.0 / baud if baud else 0.0
        slaves = TcpSlaves() if scheme == "tcp" else ModbusSlaves(clock, byte_s)
        wire = TcpWire(slaves.receive, scheme, byte_s)
        line = BadLine("relay", twin, clock, wire.send, byte_s)
        slaves.add(1, emulated_board("waveshare-poe-8", 1, twin, clock, WIRED), line)
        await wire.plug()
        port = SerialPort(PortSettings(wire.path, "relay", baud, "modbus"), clock)
        relay = ModbusRelay(RelaySettings("waveshare-poe-8", 1, WIRED), ModbusMaster(port), clock)
        try:
            if opened:
                await relay.open()
            await test(relay, twin, wire)
        finally:
            await port.detach("relay")
            await wire.unplug()

    asyncio.run(main())


@pytest.mark.parametrize("scheme", SCHEMES)
def test_a_board_behind_tcp_is_pulsed_read_and_cancelled(scheme: str) -> None:
    async def test(relay: ModbusRelay, twin: Twin, wire: TcpWire) -> None:
        receipt = await relay.pulse(Channel.VALVE, 0.5)
        assert (await relay.read()).coils[Channel.VALVE]
        assert twin.coils(receipt.accepted_s)[Channel.VALVE]
        await relay.cancel(Channel.VALVE)
        assert not (await relay.read()).coils[Channel.VALVE]

    on_tcp(scheme, test)


@pytest.mark.parametrize("scheme", SCHEMES)
def test_a_connection_that_ends_is_lost_and_comes_back_with_everything_off(scheme: str) -> None:
    async def test(relay: ModbusRelay, twin: Twin, wire: TcpWire) -> None:
        await relay.switch(Channel.LAMP, True)
        await wire.unplug()
        with pytest.raises(DeviceLost):
            await relay.read()
        await wire.plug()

        async def back() -> bool:
            try:
                return not (await relay.read()).coils[Channel.LAMP]
            except DeviceLost:
                return False

        end_s = asyncio.get_running_loop().time() + 10.0
        while not await back():
            assert asyncio.get_running_loop().time() < end_s
            await asyncio.sleep(0.05)

    on_tcp(scheme, test)


@pytest.mark.parametrize("scheme", SCHEMES)
def test_a_board_that_is_off_behind_its_gateway_is_missing(scheme: str) -> None:
    async def test(relay: ModbusRelay, twin: Twin, wire: TcpWire) -> None:
        with pytest.raises(DeviceMissing, match="silence"):
            await relay.open()

    on_tcp(scheme, test, "relay:off", opened=False)


@pytest.mark.parametrize("scheme", SCHEMES)
def test_a_garbled_answer_over_tcp_is_a_fault(scheme: str) -> None:
    async def test(relay: ModbusRelay, twin: Twin, wire: TcpWire) -> None:
        with pytest.raises((DeviceFault, WrongDevice), match="garbled"):
            await relay.open()

    on_tcp(scheme, test, "relay:garbage", opened=False)


@pytest.mark.parametrize(
    ("path", "why"),
    [
        ("tcp://127.0.0.1", "tcp://host:port"),
        ("tcp://127.0.0.1:99999", "tcp://host:port"),
        ("tcp://:502", "tcp://host:port"),
        ("tcp://127.0.0.1:1", "listens at tcp://127.0.0.1:1, found Connection refused"),
    ],
)
def test_an_address_that_leads_nowhere_is_named(path: str, why: str) -> None:
    async def main() -> None:
        port = SerialPort(PortSettings(path, "relay", 0, "modbus"), asyncio.get_running_loop().time)
        with pytest.raises(DeviceMissing, match=why):
            await port.attach("relay", lambda line: None)

    asyncio.run(main())


def test_a_late_answer_over_tcp_is_known_by_its_number() -> None:
    memory = Memory()
    memory.words[:2] = [11, 22]

    async def main() -> None:
        clock = asyncio.get_running_loop().time
        slaves = TcpSlaves()
        wire = TcpWire(slaves.receive)
        line = BadLine("relay", rig.twin(), clock, wire.send, 0.0)
        slaves.add(1, memory, line, turnaround_s=0.15)
        await wire.plug()
        port = SerialPort(PortSettings(wire.path, "bus", 0, "modbus"), clock)
        master = ModbusMaster(port, timeout_s=0.1)
        await master.attach("test", nothing)
        with pytest.raises(DeviceTimeout):
            await master.run(lambda line: line.unit("tank", 1).read_holding(0, 1))
        assert await master.run(lambda line: line.unit("tank", 1, 0.5).read_holding(1, 1)) == [22]
        await master.detach("test")
        await wire.unplug()

    asyncio.run(main())


def test_a_host_that_hangs_up_without_a_word_is_noticed() -> None:
    async def main() -> None:
        listener = socket.create_server(("127.0.0.1", 0))
        path = f"tcp://127.0.0.1:{listener.getsockname()[1]}"
        port = SerialPort(PortSettings(path, "bus", 0, "modbus"), asyncio.get_running_loop().time)
        master = ModbusMaster(port)
        await master.attach("test", nothing)
        connection, _ = listener.accept()
        connection.close()
        listener.close()
        with pytest.raises(DeviceLost):
            await master.run(lambda line: line.unit("tank", 1).read_holding(0, 1))
        await until(lambda: not port.connected)
        await master.detach("test")

    asyncio.run(main())


@pytest.mark.parametrize("scheme", SCHEMES)
def test_beside_an_owner_that_hangs_a_board_behind_tcp_is_switched_off(scheme: str) -> None:
    async def test(relay: ModbusRelay, twin: Twin, wire: TcpWire) -> None:
        receipt = await relay.pulse(Channel.VALVE, 5.0)
        assert twin.coils(receipt.accepted_s)[Channel.VALVE]
        port = relay._bus.port  # what hangs in it is the fault under test
        gate = threading.Event()
        hanging = asyncio.ensure_future(port.run(lambda line: gate.wait(5.0)))
        await asyncio.sleep(0.02)
        assert await asyncio.to_thread(relay.stop_lane.force)
        await asyncio.sleep(0.1)
        assert not twin.coils(receipt.accepted_s + 1.0)[Channel.VALVE]
        gate.set()
        await hanging

    on_tcp(scheme, test)

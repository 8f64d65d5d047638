"""Modbus programs that are not ours: clients that drive our emulated relay board, and slaves that our drivers drive."""

from __future__ import annotations

import asyncio
import re
import shutil
import subprocess
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import pytest
import serial

from drivers.emulation.reference_bus import ReferenceBus
from drivers.errors import DeviceRefused, DeviceTimeout
from drivers.line import PortSettings
from drivers.modbus_master import ModbusLine, ModbusMaster, ModbusRefusal
from drivers.modbus_probe import insist
from drivers.relay.modbus import ModbusRelay, RelaySettings
from drivers.relay.values import Channel
from drivers.serial_port import SerialPort
from tests.drivers.relay.boards import Recorder
from tests.drivers.twin import rig

pytestmark = pytest.mark.peer

BAUD = 115200
WIRED = {Channel.VALVE: 1, Channel.PUMP: 2, Channel.LAMP: 3}

MBPOLL, SOCAT, GCC = shutil.which("mbpoll"), shutil.which("socat"), shutil.which("gcc")
LIBMODBUS = Path("/usr/include/modbus/modbus.h")
needs_mbpoll = pytest.mark.skipif(MBPOLL is None, reason="mbpoll is not installed: apt install mbpoll")
needs_socat = pytest.mark.skipif(SOCAT is None, reason="socat is not installed: apt install socat")
needs_libmodbus = pytest.mark.skipif(
    GCC is None or not LIBMODBUS.is_file(),
    reason="gcc or libmodbus is not installed: apt install gcc libmodbus-dev",
)

SLAVE = r"""
#include <modbus.h>
#include <stdio.h>
int main(int argc, char **argv) {
    modbus_t *bus = modbus_new_rtu(argv[1], 115200, 'N', 8, 1);
    modbus_mapping_t *map = modbus_mapping_new(16, 16, 64, 64);
    uint8_t request[MODBUS_RTU_MAX_ADU_LENGTH];
    modbus_set_slave(bus, 1);
    map->tab_registers[0] = 1;
    if (modbus_connect(bus) < 0) return 1;
    puts("ready"); fflush(stdout);
    for (;;) { int n = modbus_receive(bus, request); if (n > 0) modbus_reply(bus, request, n, map); }
}
"""


@asynccontextmanager
async def emulated_board() -> AsyncIterator[tuple[ReferenceBus, Any]]:
    clock = asyncio.get_running_loop().time
    zero_s = clock()
    twin = rig.twin()
    bus = ReferenceBus(twin, lambda: clock() - zero_s, wired=WIRED)
    bus.wire.plug()
    try:
        yield bus, lambda channel: twin.coils(clock() - zero_s)[channel]
    finally:
        bus.wire.unplug()


async def mbpoll(path: str, kind: str, address: int, *values: int, count: int = 1) -> str:
    """``kind`` as mbpoll has it: 0 coils, 4 holding registers."""
    assert MBPOLL is not None
    what = ["-m", "rtu", "-a", "1", "-b", str(BAUD), "-P", "none", "-t", kind, "-0", "-r", str(address), "-o", "1"]
    where = [path, "--", *map(str, values)] if values else ["-1", "-q", "-c", str(count), path]
    process = await asyncio.create_subprocess_exec(
        MBPOLL, *what, *where, stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.STDOUT
    )
    told, _ = await asyncio.wait_for(process.communicate(), 20.0)
    return told.decode()


def numbers(told: str) -> list[int]:
    return [int(number) for number in re.findall(r"^\[\d+\]:\s+(-?\d+)", told, re.MULTILINE)]


@needs_mbpoll
def test_mbpoll_reads_and_switches_the_emulated_board() -> None:
    async def main() -> None:
        async with emulated_board() as (bus, on):
            path = bus.wire.path
            assert numbers(await mbpoll(path, "0", 0, count=8)) == [0] * 8
            await mbpoll(path, "0", 2, 1)
            assert on(Channel.LAMP)
            assert numbers(await mbpoll(path, "0", 0, count=8)) == [0, 0, 1, 0, 0, 0, 0, 0]
            await mbpoll(path, "0", 0, *[0] * 8)
            assert not on(Channel.LAMP)
            assert numbers(await mbpoll(path, "4", 0x8000)) == [200]
            assert "Illegal data address" in await mbpoll(path, "4", 0x1234)

    asyncio.run(main())


def test_modbus_tk_reads_and_switches_the_emulated_board_and_opens_a_valve_for_hours() -> None:
    modbus_tk = pytest.importorskip("modbus_tk", reason="modbus_tk is not installed: pip install modbus_tk")
    from modbus_tk import defines, modbus_rtu

    assert modbus_tk is not None

    def client(path: str, job: Callable[[Any], Any]) -> Any:
        with serial.Serial(path, BAUD) as port:
            master = modbus_rtu.RtuMaster(port)
            master.set_timeout(2.0)
            return job(master)

    async def main() -> None:
        async with emulated_board() as (bus, on):
            path = bus.wire.path

            async def ask(*request: Any, **more: Any) -> Any:
                return await asyncio.to_thread(client, path, lambda master: master.execute(1, *request, **more))

            assert await ask(defines.READ_COILS, 0, 8) == (0,) * 8
            await ask(defines.WRITE_SINGLE_COIL, 2, output_value=1)
            assert on(Channel.LAMP)
            assert await ask(defines.READ_HOLDING_REGISTERS, 0x4000, 1) == (1,)
            await ask(defines.WRITE_MULTIPLE_COILS, 0, output_value=[0] * 8)
            assert not on(Channel.LAMP)
            await ask(defines.WRITE_SINGLE_COIL, 0x0200, output_value=7)  # it sends FF00, which is 6528 s
            assert bus.board.outputs.timed(1)
            await asyncio.sleep(1.2)
            assert on(Channel.VALVE)
            await ask(defines.WRITE_SINGLE_COIL, 0, output_value=0)
            assert not on(Channel.VALVE)

    asyncio.run(main())


@asynccontextmanager
async def null_modem(folder: Path) -> AsyncIterator[tuple[str, str]]:
    """Two ports that are one wire."""
    ends = [folder / "host", folder / "device"]
    assert SOCAT is not None
    process = await asyncio.create_subprocess_exec(SOCAT, *(f"pty,raw,echo=0,link={end}" for end in ends))
    try:
        while not all(end.exists() for end in ends):
            assert process.returncode is None
            await asyncio.sleep(0.01)
        yield str(ends[0]), str(ends[1])
    finally:
        process.terminate()
        await process.wait()


@asynccontextmanager
async def libmodbus_slave(folder: Path, path: str) -> AsyncIterator[None]:
    source, program = folder / "slave.c", folder / "slave"
    source.write_text(SLAVE)
    assert GCC is not None
    await asyncio.to_thread(
        subprocess.run, [GCC, "-I/usr/include/modbus", source, "-o", program, "-lmodbus"], check=True
    )
    process = await asyncio.create_subprocess_exec(program, path, stdout=asyncio.subprocess.PIPE)
    try:
        assert process.stdout is not None
        assert await asyncio.wait_for(process.stdout.readline(), 10.0) == b"ready\n"
        yield
    finally:
        process.kill()
        await process.wait()


async def master_at(path: str) -> tuple[SerialPort, ModbusMaster, Recorder]:
    trace = Recorder()
    clock = asyncio.get_running_loop().time
    port = SerialPort(PortSettings(path, "relay", BAUD, "modbus"), clock, trace=trace)  # type: ignore[arg-type]
    return port, ModbusMaster(port, timeout_s=0.5), trace


@needs_socat
@needs_libmodbus
def test_every_function_works_with_a_slave_of_libmodbus(tmp_path: Path) -> None:
    def job(line: ModbusLine) -> None:
        unit = line.unit("relay", 1)
        unit.write_coil(0, 0xFF00)
        unit.write_coils(3, [True, False, True])
        assert unit.read_coils(0, 8) == [True, False, False, True, False, True, False, False]
        assert unit.read_discrete_inputs(0, 16) == [False] * 16
        unit.write_register(8, 0xBEEF)
        unit.write_registers(9, [1, 2, 3])
        assert unit.read_holding(8, 4) == [0xBEEF, 1, 2, 3]
        assert unit.read_input_registers(0, 2) == [0, 0]
        with pytest.raises(ModbusRefusal, match="illegal data address"):
            unit.read_holding(100, 1)
        with pytest.raises(ModbusRefusal, match="illegal data value"):
            unit.write_coil(0, 7)  # a flash time is no coil state to a plain slave

    async def main() -> None:
        async with null_modem(tmp_path) as (host, device), libmodbus_slave(tmp_path, device):
            port, master, _ = await master_at(host)
            await master.attach("test", lambda line: None)
            await master.run(job)
            await port.detach("test")

    asyncio.run(main())


@needs_socat
@needs_libmodbus
def test_a_slave_that_swallows_the_frame_after_an_absent_id_is_found_by_asking_again(tmp_path: Path) -> None:
    def job(line: ModbusLine) -> list[bool]:
        with pytest.raises(DeviceTimeout):
            line.unit("other", 9).read_coils(0, 1)
        return insist(lambda: line.unit("relay", 1).read_coils(0, 2))

    async def main() -> None:
        async with null_modem(tmp_path) as (host, device), libmodbus_slave(tmp_path, device):
            port, master, _ = await master_at(host)
            await master.attach("test", lambda line: None)
            assert await master.run(job) == [False, False]
            await port.detach("test")

    asyncio.run(main())


@needs_socat
@needs_libmodbus
def test_the_relay_driver_drives_a_slave_of_libmodbus(tmp_path: Path) -> None:
    async def main() -> None:
        async with null_modem(tmp_path) as (host, device), libmodbus_slave(tmp_path, device):
            _, master, trace = await master_at(host)
            clock = asyncio.get_running_loop().time
            relay = ModbusRelay(RelaySettings("lc-8", 1, WIRED, reply_timeout_s=0.5), master, clock)
            await relay.open()
            await relay.switch(Channel.LAMP, True)
            assert (await relay.read()).coils == {Channel.VALVE: False, Channel.PUMP: False, Channel.LAMP: True}
            await relay.pulse(Channel.VALVE, 0.7)
            assert trace.requests()[-1][:11] == bytes.fromhex("01 10 00 03 00 02 04 00 02 00 07")
            await relay.all_off()
            assert not any((await relay.read()).coils.values())
            await relay.close()

    asyncio.run(main())


@needs_socat
@pytest.mark.filterwarnings("ignore:isSet:DeprecationWarning")
def test_the_relay_driver_drives_a_slave_of_modbus_tk(tmp_path: Path) -> None:
    pytest.importorskip("modbus_tk", reason="modbus_tk is not installed: pip install modbus_tk")
    from modbus_tk import defines, modbus_rtu

    async def main() -> None:
        async with null_modem(tmp_path) as (host, device):
            server = modbus_rtu.RtuServer(serial.Serial(device, BAUD))
            slave = server.add_slave(1)
            slave.add_block("coils", defines.COILS, 0, 8)
            server.start()
            try:
                _, master, _ = await master_at(host)
                clock = asyncio.get_running_loop().time
                relay = ModbusRelay(RelaySettings("generic-coils", 1, WIRED, reply_timeout_s=0.5), master, clock)
                await relay.open()
                await relay.switch(Channel.LAMP, True)
                assert slave.get_values("coils", 0, 8) == (0, 0, 1, 0, 0, 0, 0, 0)
                assert (await relay.read()).coils[Channel.LAMP]
                with pytest.raises(DeviceRefused, match="neither time a pulse"):
                    await relay.pulse(Channel.VALVE, 0.5)
                await relay.close()
                assert slave.get_values("coils", 0, 8) == (0,) * 8
            finally:
                await asyncio.to_thread(server.stop)

    asyncio.run(main())

"""A Modbus client that is not ours reads and drives the emulated controller."""

from __future__ import annotations

import asyncio
import re
import shutil

import pytest

from drivers.emulation.bad_line import BadLine
from drivers.emulation.modbus_slave import ModbusSlaves
from drivers.emulation.wire import PtyWire
from drivers.wheels import zlac_registers as r
from drivers.wheels.emulator import Zlac8015dEmulator
from tests.drivers.twin import rig

BAUD = 115200
MBPOLL = shutil.which("mbpoll")
pytestmark = pytest.mark.skipif(MBPOLL is None, reason="mbpoll is not installed: apt install mbpoll")


async def mbpoll(path: str, address: int, *values: int, count: int = 1) -> list[int]:
    """Write ``values`` from ``address`` on, or read ``count`` registers."""
    assert MBPOLL is not None
    what = ["-m", "rtu", "-a", "1", "-b", str(BAUD), "-P", "none", "-t", "4", "-0", "-r", str(address), "-o", "1"]
    where = [path, "--", *map(str, values)] if values else ["-1", "-q", "-c", str(count), path]
    process = await asyncio.create_subprocess_exec(
        MBPOLL, *what, *where, stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.STDOUT
    )
    told, _ = await asyncio.wait_for(process.communicate(), 20.0)
    assert process.returncode == 0, told.decode()
    return [int(number) for number in re.findall(r"^\[\d+\]:\s+(-?\d+)", told.decode(), re.MULTILINE)]


def test_mbpoll_reads_sets_up_and_turns_the_wheels() -> None:
    twin = rig.twin()

    async def main() -> None:
        clock = asyncio.get_running_loop().time
        zero_s = clock()
        wheels = Zlac8015dEmulator(twin, lambda: clock() - zero_s)
        slaves = ModbusSlaves(clock, 10.0 / BAUD)
        wire = PtyWire(BAUD, slaves.receive)
        slaves.add(1, wheels, BadLine("wheels", twin, lambda: clock() - zero_s, wire.send, wire.byte_s))
        wire.plug()
        reading = await mbpoll(wire.path, r.FIRST_READING, count=r.READING_WORDS)
        assert len(reading) == r.READING_WORDS
        assert reading[r.BUS_VOLTAGE.address - r.FIRST_READING] == pytest.approx(2580, abs=20)
        await mbpoll(wire.path, r.MODE.address, r.VELOCITY_MODE)
        await mbpoll(wire.path, r.CONTROL.address, r.Control.ENABLE)
        await mbpoll(wire.path, r.LEFT_TARGET.address, 20, r.word_of(-20))
        await asyncio.sleep(1.0)
        odometry = await mbpoll(wire.path, r.FIRST_ODOMETRY, count=r.ODOMETRY_WORDS)
        assert odometry[6] == pytest.approx(200, abs=6)
        assert r.signed_16(odometry[7] & 0xFFFF) == pytest.approx(-200, abs=6)
        assert twin.base_pose[0] > 0.05
        await mbpoll(wire.path, r.LEFT_TARGET.address, 0, 0)
        wire.unplug()

    asyncio.run(main())

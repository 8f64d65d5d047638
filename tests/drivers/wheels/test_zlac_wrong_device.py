"""Something else behind the port is named and not written to."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

import pytest

from drivers.emulation.bad_line import BadLine
from drivers.emulation.modbus_slave import ModbusSlaves
from drivers.emulation.wire import PtyWire
from drivers.errors import DeviceError, DeviceFault, DeviceMissing, WrongDevice
from drivers.line import PortSettings
from drivers.modbus_frames import FrameFinder, request_size
from drivers.modbus_master import ModbusMaster
from drivers.relay.emulator import emulated_board
from drivers.relay.values import Channel
from drivers.serial_port import SerialPort
from drivers.wheels.zlac8015d import Zlac8015dWheels
from drivers.wheels.zlac_settings import Zlac8015dSettings
from tests.contract.leaping import LeapingLoop
from tests.drivers.twin import rig

BAUD = 115200
LONGEST_OPEN_S = 3.0
SETTINGS = Zlac8015dSettings(radius_m=0.1, track_m=0.5, max_speed_m_s=0.5, max_acceleration_m_s2=0.5)
WIRED = {Channel.VALVE: 1, Channel.PUMP: 2}


def opened_on(answering: Callable[[PtyWire], Callable[[bytes], None]]) -> tuple[DeviceError, bytes]:
    """What opening on something else ends in, and what had been written by then."""
    heard = bytearray()

    async def main() -> DeviceError:
        loop = asyncio.get_running_loop()
        assert isinstance(loop, LeapingLoop)

        def receive(data: bytes) -> None:
            heard.extend(data)
            answer(data)

        wire = PtyWire(BAUD, receive)
        answer = answering(wire)
        wire.plug()
        port = SerialPort(PortSettings(wire.path, "wheels", BAUD, "modbus"), loop.time)
        loop.busy = lambda: port.busy or wire.unread > 0
        begun_s = loop.time()
        with pytest.raises(DeviceError) as caught:
            await Zlac8015dWheels(SETTINGS, ModbusMaster(port), loop.time).open()
        assert loop.time() - begun_s < LONGEST_OPEN_S
        wire.unplug()
        return caught.value

    with asyncio.Runner(loop_factory=LeapingLoop) as runner:
        return runner.run(main()), bytes(heard)


def functions(heard: bytes) -> set[int]:
    return {found.data[1] for found in FrameFinder(request_size).feed(heard)}


@pytest.mark.parametrize("profile", ["waveshare-8", "lc-8", "r4d8a08", "ryn408f"])
def test_a_relay_board_is_a_wrong_device_and_none_of_its_coils_moves(profile: str) -> None:
    twin = rig.twin()

    def board(wire: PtyWire) -> Callable[[bytes], None]:
        clock = asyncio.get_running_loop().time
        slaves = ModbusSlaves(clock, wire.byte_s)
        relay = emulated_board(profile, 1, twin, clock, WIRED)
        slaves.add(1, relay, BadLine("relay", twin, clock, wire.send, wire.byte_s))
        return slaves.receive

    error, heard = opened_on(board)
    assert isinstance(error, WrongDevice)
    assert "expected a ZLAC8015D as unit 1" in str(error)
    assert functions(heard) == {3}
    assert not any(twin.coils(twin.now_s).values())


def test_silence_is_a_missing_device() -> None:
    error, heard = opened_on(lambda wire: lambda data: None)
    assert isinstance(error, DeviceMissing)
    assert "check power, cable (A to A, B to B), unit id and baud rate" in str(error)
    assert functions(heard) == {3}


def test_a_talker_that_speaks_no_modbus_is_told_of_as_garbled() -> None:
    sentence = b"$GPGGA,092750.000,5321.6802,N,00630.3372,W,1,8,1.03,61.7,M,55.2,M,,*76\r\n"
    error, heard = opened_on(lambda wire: lambda data: wire.send(sentence))
    assert isinstance(error, DeviceFault)
    assert "a garbled answer" in error.found
    assert "baud rate" in error.remedy
    assert functions(heard) == {3}

"""Long pulses: what the host sends to keep them up, and what becomes of them when it cannot."""

from __future__ import annotations

import asyncio
import threading
from contextlib import suppress

import pytest

from drivers.emulation.modbus_slave import DEVICE_FAILURE, ModbusException
from drivers.errors import DeviceFault, DeviceTimeout
from drivers.relay.emulator import WirenboardBoard
from drivers.relay.values import Channel
from tests.drivers.relay.boards import Bench, on_board, until

FLASH = bytes.fromhex("010502")
OFF = bytes.fromhex("01 05 00 00 00 00 cd ca")


def flashes(bench: Bench) -> list[float]:
    """The pulses of the board's own timer that were sent, in seconds."""
    return [0.1 * int.from_bytes(frame[4:6], "big") for frame in bench.trace.writes() if frame.startswith(FLASH)]


def test_no_frame_ever_asks_for_more_than_a_lease() -> None:
    async def test(bench: Bench) -> None:
        receipt = await bench.relay.pulse(Channel.VALVE, 2.35)
        assert receipt.duration_s == pytest.approx(2.4)
        await asyncio.sleep(3.0)
        sent_s = flashes(bench)
        assert len(sent_s) >= 4
        assert max(sent_s) == pytest.approx(0.8)

    on_board("waveshare-8", test, lease_s=0.8)


def test_a_pulse_within_a_lease_is_one_frame() -> None:
    async def test(bench: Bench) -> None:
        before = len(bench.trace.requests())
        await bench.relay.pulse(Channel.VALVE, 0.7)
        await asyncio.sleep(1.0)
        assert bench.trace.requests()[before:] == [bytes.fromhex("01 05 02 00 00 07 8d b0")]

    on_board("waveshare-8", test, lease_s=1.0)


def test_the_coil_opens_at_the_end_of_the_pulse_and_not_at_the_end_of_the_last_lease() -> None:
    async def test(bench: Bench) -> None:
        receipt = await bench.relay.pulse(Channel.VALVE, 1.3)
        await until(lambda: not bench.on(), 5.0)
        assert bench.clock() - receipt.sent_s >= 1.3
        await until(lambda: not bench.port.busy)
        assert bench.trace.writes()[-1] == OFF

    on_board("waveshare-8", test, lease_s=0.5)


def test_a_lost_answer_to_a_renewal_does_not_end_the_pulse() -> None:
    async def test(bench: Bench) -> None:
        receipt = await bench.relay.pulse(Channel.VALVE, 3.0)
        while bench.clock() < receipt.sent_s + 2.9:
            assert bench.on()
            await asyncio.sleep(0.05)
        await asyncio.sleep(receipt.accepted_s + 3.3 - bench.clock())
        assert not bench.on()
        assert bench.master.statistics.garbled > 0
        await bench.relay.read()

    on_board("waveshare-8", test, "relay:garbage@0.5s+0.4s", lease_s=1.0)


def test_a_board_that_falls_silent_ends_the_pulse_within_a_lease_and_the_next_call_says_so() -> None:
    async def test(bench: Bench) -> None:
        await asyncio.sleep(0.9 - bench.clock())
        await bench.relay.pulse(Channel.VALVE, 20.0)
        await asyncio.sleep(1.5)
        assert not bench.on()
        await asyncio.sleep(1.0)
        assert not bench.on()
        with pytest.raises(DeviceFault, match=r"pulse on channel 1 to be kept up .* silence"):
            await bench.relay.read()
        assert not (await bench.relay.read()).coils[Channel.VALVE]

    on_board("waveshare-8", test, "relay:off@1s+1s", lease_s=0.5)


def test_a_renewal_that_comes_too_late_does_not_open_the_valve_again() -> None:
    async def test(bench: Bench) -> None:
        await bench.relay.pulse(Channel.VALVE, 20.0)
        held_up = threading.Event()
        blocking = asyncio.ensure_future(bench.master.run(lambda line: held_up.wait(5.0)))
        await until(lambda: not bench.on())
        sent = len(flashes(bench))
        held_up.set()
        await blocking
        await asyncio.sleep(0.3)
        assert not bench.on()
        assert len(flashes(bench)) == sent
        with pytest.raises(DeviceFault, match="too busy to renew"):
            await bench.relay.read()

    on_board("waveshare-8", test, lease_s=0.4)


def test_a_new_pulse_takes_the_place_of_a_long_one() -> None:
    async def test(bench: Bench) -> None:
        await bench.relay.pulse(Channel.VALVE, 10.0)
        await bench.relay.pulse(Channel.VALVE, 0.2)
        await asyncio.sleep(1.0)
        assert not bench.on()
        assert not bench.port.busy

    on_board("waveshare-8", test, lease_s=0.4)


def test_pulses_on_two_channels_are_kept_up_side_by_side() -> None:
    async def test(bench: Bench) -> None:
        await bench.relay.pulse(Channel.PUMP, 2.0)
        await bench.relay.pulse(Channel.VALVE, 1.0)
        await asyncio.sleep(0.7)
        assert bench.on(Channel.PUMP)
        assert bench.on(Channel.VALVE)
        await asyncio.sleep(0.7)
        assert bench.on(Channel.PUMP)
        assert not bench.on(Channel.VALVE)
        await asyncio.sleep(1.0)
        assert not bench.on(Channel.PUMP)

    on_board("waveshare-8", test, lease_s=0.4)


def test_a_coil_that_may_be_on_after_a_lost_answer_is_switched_off_by_the_host() -> None:
    async def test(bench: Bench) -> None:
        await asyncio.sleep(1.0)
        with pytest.raises(DeviceFault, match="garbled"):
            await bench.relay.pulse(Channel.VALVE, 20.0)
        await until(lambda: not bench.on(), 3.0)
        await asyncio.sleep(1.0)
        assert not bench.on()

    on_board("wb-mr6", test, "relay:garbage@1s+2s", watchdog_s=10.0)


def test_a_coil_that_will_not_go_off_is_left_to_the_watchdog_in_silence() -> None:
    class Defective(WirenboardBoard):
        def write_coil(self, address: int, value: int) -> None:
            if value == 0:
                raise ModbusException(DEVICE_FAILURE)
            super().write_coil(address, value)

    async def test(bench: Bench) -> None:
        await bench.relay.pulse(Channel.VALVE, 0.5)
        bench.bus.board.__class__ = Defective
        reading = 0
        for _ in range(40):  # whoever polls meanwhile is kept from feeding the watchdog
            with suppress(DeviceFault):
                await bench.relay.read()
                reading += 1
            await asyncio.sleep(0.1)
        assert reading
        assert not bench.on()
        with pytest.raises(DeviceFault, match=r"channel 1 to go off.*device failure.*silence"):
            await bench.relay.read()
        bench.bus.board.__class__ = WirenboardBoard
        await bench.relay.cancel(Channel.VALVE)
        assert not (await bench.relay.read()).coils[Channel.VALVE]

    on_board("wb-mr6", test, watchdog_s=1.0)


def test_a_stop_that_is_not_answered_is_given_again_to_a_board_without_timers() -> None:
    async def test(bench: Bench) -> None:
        await bench.relay.pulse(Channel.VALVE, 10.0)
        await asyncio.sleep(1.05 - bench.clock())
        with pytest.raises(DeviceTimeout):
            await bench.relay.cancel(Channel.VALVE)
        assert bench.on()
        await until(lambda: not bench.on(), 3.0)
        assert bench.bus.board.outputs.contacts()[0] is False

    on_board("wb-mr6", test, "relay:off@1s+0.7s", watchdog_s=10.0)


def test_a_board_that_cannot_be_switched_off_is_left_to_its_watchdog() -> None:
    async def test(bench: Bench) -> None:
        await asyncio.sleep(0.9 - bench.clock())
        await bench.relay.pulse(Channel.VALVE, 1.0)
        await asyncio.sleep(3.0 - bench.clock())
        assert not bench.on()
        with pytest.raises((DeviceTimeout, DeviceFault)):
            await bench.relay.read()

    on_board("wb-mr6", test, "relay:off@1.1s", watchdog_s=1.0)

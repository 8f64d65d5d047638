"""Whatever shuts goes before whatever waits."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Awaitable, Callable

import pytest

from drivers.errors import DeviceLost, DeviceRefused, DeviceTimeout
from drivers.modbus_frames import with_crc
from drivers.relay.modbus import ModbusRelay
from drivers.relay.values import Channel
from tests.drivers.relay.boards import Bench, on_board, until

SHUTS: dict[str, Callable[[ModbusRelay], Awaitable[None]]] = {
    "cancel": lambda relay: relay.cancel(Channel.VALVE),
    "all_off": lambda relay: relay.all_off(),
    "switch off": lambda relay: relay.switch(Channel.VALVE, False),
    "close": lambda relay: relay.close(),
    "posted": lambda relay: asyncio.wrap_future(relay.post_all_off()),
}


@pytest.mark.parametrize("name", SHUTS)
def test_what_shuts_overtakes_a_full_queue(name: str) -> None:
    async def test(bench: Bench) -> None:
        await bench.relay.pulse(Channel.VALVE, 5.0)
        gate = threading.Event()
        blocking = asyncio.ensure_future(bench.master.run(lambda line: gate.wait(5.0)))
        reads = [asyncio.ensure_future(bench.relay.read()) for _ in range(20)]
        await asyncio.sleep(0.02)
        sent = len(bench.trace.requests())
        shutting = asyncio.ensure_future(SHUTS[name](bench.relay))
        await asyncio.sleep(0.02)
        gate.set()
        await until(lambda: not bench.on())
        assert bench.trace.requests()[sent][1] in (5, 15)
        await shutting
        await blocking
        await asyncio.gather(*reads, return_exceptions=True)

    on_board("waveshare-8", test)


def test_a_pulse_waits_its_turn() -> None:
    async def test(bench: Bench) -> None:
        gate = threading.Event()
        blocking = asyncio.ensure_future(bench.master.run(lambda line: gate.wait(5.0)))
        read = asyncio.ensure_future(bench.relay.read())
        await asyncio.sleep(0.02)
        pulse = asyncio.ensure_future(bench.relay.pulse(Channel.VALVE, 0.2))
        await asyncio.sleep(0.02)
        gate.set()
        await asyncio.gather(blocking, read, pulse)
        assert [frame[1] for frame in bench.trace.requests()[-2:]] == [1, 5]

    on_board("waveshare-8", test)


@pytest.mark.parametrize("name", SHUTS)
def test_a_pulse_that_waits_does_not_open_what_a_stop_before_it_shut(name: str) -> None:
    async def test(bench: Bench) -> None:
        gate = threading.Event()
        blocking = asyncio.ensure_future(bench.master.run(lambda line: gate.wait(5.0)))
        await asyncio.sleep(0.02)
        pulse = asyncio.ensure_future(bench.relay.pulse(Channel.VALVE, 0.2))
        lamp = asyncio.ensure_future(bench.relay.switch(Channel.LAMP, True))
        await asyncio.sleep(0.02)
        shutting = asyncio.ensure_future(SHUTS[name](bench.relay))
        await asyncio.sleep(0.02)
        gate.set()
        for opening in (pulse, lamp):
            with pytest.raises((DeviceRefused, DeviceLost)):
                await opening
        await asyncio.gather(blocking, shutting)
        assert not any(frame[1:3] == b"\x05\x02" or frame[4:6] == b"\xff\x00" for frame in bench.trace.writes())

    on_board("waveshare-8", test)


def test_a_pulse_that_waits_and_whose_caller_is_gone_does_not_open() -> None:
    async def test(bench: Bench) -> None:
        gate = threading.Event()
        blocking = asyncio.ensure_future(bench.master.run(lambda line: gate.wait(5.0)))
        await asyncio.sleep(0.02)
        pulse = asyncio.ensure_future(bench.relay.pulse(Channel.VALVE, 0.2))
        await asyncio.sleep(0.02)
        pulse.cancel()
        await asyncio.sleep(0.02)
        gate.set()
        await blocking
        await bench.relay.read()
        assert not any(frame[1:3] == b"\x05\x02" for frame in bench.trace.writes())

    on_board("waveshare-8", test)


def test_everything_may_be_switched_off_from_another_thread() -> None:
    async def test(bench: Bench) -> None:
        await bench.relay.pulse(Channel.VALVE, 5.0)
        posted = await asyncio.to_thread(bench.relay.post_all_off)
        await asyncio.wrap_future(posted)
        assert not bench.on()
        await asyncio.sleep(0.3)
        assert not bench.on()

    on_board("waveshare-8", test)


@pytest.mark.parametrize("profile", ["waveshare-8", "lc-8", "r4d8a08", "wb-mr6"])
def test_beside_an_owner_that_hangs_everything_is_switched_off_for_good(profile: str) -> None:
    """F30."""

    async def test(bench: Bench) -> None:
        await bench.relay.pulse(Channel.VALVE, 4.0)
        await bench.relay.pulse(Channel.PUMP, 4.0)
        gate = threading.Event()
        hanging = asyncio.ensure_future(bench.master.run(lambda line: gate.wait(10.0)))
        await asyncio.sleep(0.02)
        stopping = bench.relay.stop_lane.post("of a test")
        assert bench.on()
        assert await asyncio.to_thread(bench.relay.stop_lane.force)
        await until(lambda: not bench.on())
        assert not stopping.done()
        await asyncio.sleep(0.3)
        assert not bench.on()
        gate.set()
        await hanging
        await asyncio.wrap_future(stopping)  # and the owner, when it goes on, begins with the stop
        await asyncio.sleep(0.3)
        assert not bench.on()

    on_board(profile, test)


def test_after_a_posted_stop_nothing_opens_until_it_is_released() -> None:
    async def test(bench: Bench) -> None:
        await asyncio.wrap_future(bench.relay.stop_lane.post("the event loop stalled"))
        for opening in (bench.relay.pulse(Channel.VALVE, 0.3), bench.relay.switch(Channel.LAMP, True)):
            with pytest.raises(DeviceRefused, match="the event loop stalled"):
                await opening
        await bench.relay.cancel(Channel.VALVE)
        await bench.relay.all_off()
        await bench.relay.read()
        assert not bench.on()
        bench.relay.stop_lane.release()
        await bench.relay.pulse(Channel.VALVE, 0.3)
        assert bench.on()

    on_board("waveshare-8", test)


def test_a_board_that_is_closed_or_gone_cannot_be_forced() -> None:
    async def test(bench: Bench) -> None:
        bench.bus.wire.unplug()
        with pytest.raises(DeviceLost):
            await asyncio.to_thread(bench.relay.stop_lane.force)
        await until(lambda: not bench.master.port.connected)
        with pytest.raises(DeviceLost, match="gone for"):
            await asyncio.to_thread(bench.relay.stop_lane.force)

    on_board("waveshare-8", test)


def test_a_close_that_is_not_answered_is_tried_three_times() -> None:
    async def test(bench: Bench) -> None:
        await bench.relay.pulse(Channel.VALVE, 0.5)
        await asyncio.sleep(1.1 - bench.clock())
        sent = len(bench.trace.writes())
        with pytest.raises(DeviceTimeout, match="silence"):
            await bench.relay.cancel(Channel.VALVE)
        assert bench.trace.writes()[sent:] == 3 * [bytes.fromhex("01 05 00 00 00 00 cd ca")]

    on_board("waveshare-8", test, "relay:off@1s")


def test_an_opening_that_is_not_answered_is_tried_once() -> None:
    async def test(bench: Bench) -> None:
        await asyncio.sleep(1.1)
        sent = len(bench.trace.writes())
        with pytest.raises(DeviceTimeout, match="silence"):
            await bench.relay.pulse(Channel.VALVE, 0.2)
        assert bench.trace.writes()[sent:] == [with_crc(bytes.fromhex("01 05 02 00 00 02"))]

    on_board("waveshare-8", test, "relay:off@1s")


def test_a_reading_comes_through_when_two_of_three_answers_are_lost() -> None:
    async def test(bench: Bench) -> None:
        await asyncio.sleep(1.0)
        failed = 0
        for _ in range(40):
            try:
                await bench.relay.read()
            except DeviceTimeout:
                failed += 1
        assert failed <= 14  # one in eight on the average, where one try would lose one in two

    on_board("waveshare-8", test, "relay:intermittent@1s", reply_timeout_s=0.05)

"""What every relay board keeps, judged by coils and millilitres of the twin."""

from __future__ import annotations

import asyncio

import pytest

from drivers.errors import DeviceFault, DeviceLost, DeviceMissing, DeviceRefused, DeviceTimeout
from drivers.relay.interface import RelayBoard
from drivers.relay.values import Channel
from drivers.twin import Twin
from tests.contract.conftest import Bench


def now() -> float:
    return asyncio.get_running_loop().time()


def on(twin: Twin, channel: Channel) -> bool:
    return twin.coils(now())[channel]


def test_every_coil_is_off_once_the_board_is_open(relay: Bench[RelayBoard]) -> None:
    async def test(board: RelayBoard, twin: Twin) -> None:
        await board.switch(Channel.LAMP, True)
        await board.open()
        assert not any(twin.coils(now()).values())

    relay.run(test)


def test_opening_fails_when_a_coil_stays_on(relay: Bench[RelayBoard]) -> None:
    async def test(board: RelayBoard, twin: Twin) -> None:
        await board.switch(Channel.LAMP, True)
        await asyncio.sleep(2.0)
        with pytest.raises(DeviceFault, match="lamp on"):
            await board.open()

    relay.run(test, "relay:stuck@1s")


@pytest.mark.parametrize("channel", [Channel.VALVE, Channel.PUMP])
def test_valve_and_pump_are_never_simply_switched_on(relay: Bench[RelayBoard], channel: Channel) -> None:
    async def test(board: RelayBoard, twin: Twin) -> None:
        with pytest.raises(DeviceRefused):
            await board.switch(channel, True)
        await asyncio.sleep(0.1)
        assert not on(twin, channel)

    relay.run(test)


def test_the_lamp_stays_on_until_it_is_switched_off(relay: Bench[RelayBoard]) -> None:
    async def test(board: RelayBoard, twin: Twin) -> None:
        await board.switch(Channel.LAMP, True)
        await asyncio.sleep(100.0)
        assert on(twin, Channel.LAMP)
        await board.switch(Channel.LAMP, False)
        assert not on(twin, Channel.LAMP)

    relay.run(test)


@pytest.mark.parametrize("duration_s", [0.0, -1.0, 25.6, float("nan"), float("inf")])
def test_a_pulse_outside_the_boards_range_is_refused(relay: Bench[RelayBoard], duration_s: float) -> None:
    async def test(board: RelayBoard, twin: Twin) -> None:
        with pytest.raises(DeviceRefused):
            await board.pulse(Channel.VALVE, duration_s)
        await asyncio.sleep(0.1)
        assert not on(twin, Channel.VALVE)

    relay.run(test)


def test_the_coil_closes_between_the_receipts_stamps(relay: Bench[RelayBoard]) -> None:
    async def test(board: RelayBoard, twin: Twin) -> None:
        sent_s = now()
        receipt = await board.pulse(Channel.VALVE, 0.5)
        assert sent_s <= receipt.sent_s < receipt.accepted_s <= now()
        assert on(twin, Channel.VALVE)

    relay.run(test)


def test_a_pulse_ends_by_itself_after_its_rounded_duration(relay: Bench[RelayBoard]) -> None:
    async def test(board: RelayBoard, twin: Twin) -> None:
        receipt = await board.pulse(Channel.VALVE, 0.41)
        quantum_s = board.capability.pulse_quantum_s
        assert receipt.duration_s == pytest.approx(round(receipt.duration_s / quantum_s) * quantum_s)
        assert 0.41 <= receipt.duration_s < 0.41 + quantum_s
        await asyncio.sleep(receipt.sent_s + receipt.duration_s - now() - 0.001)
        assert on(twin, Channel.VALVE)
        await asyncio.sleep(receipt.accepted_s + receipt.duration_s - now() + 0.001)
        assert not on(twin, Channel.VALVE)

    relay.run(test)


def test_the_longest_pulse_is_taken(relay: Bench[RelayBoard]) -> None:
    async def test(board: RelayBoard, twin: Twin) -> None:
        receipt = await board.pulse(Channel.PUMP, board.capability.pulse_max_s)
        assert receipt.duration_s == pytest.approx(board.capability.pulse_max_s)

    relay.run(test)


def test_a_pulse_on_a_running_pulse_restarts_its_timer(relay: Bench[RelayBoard]) -> None:
    async def test(board: RelayBoard, twin: Twin) -> None:
        await board.pulse(Channel.VALVE, 1.0)
        await asyncio.sleep(0.8)
        receipt = await board.pulse(Channel.VALVE, 0.5)
        await asyncio.sleep(0.4)
        assert on(twin, Channel.VALVE)
        await asyncio.sleep(receipt.accepted_s + 0.5 - now() + 0.001)
        assert not on(twin, Channel.VALVE)

    relay.run(test)


def test_a_restarted_pulse_may_be_shorter_than_what_was_left(relay: Bench[RelayBoard]) -> None:
    async def test(board: RelayBoard, twin: Twin) -> None:
        await board.pulse(Channel.VALVE, 5.0)
        await board.pulse(Channel.VALVE, 0.2)
        await asyncio.sleep(0.25)
        assert not on(twin, Channel.VALVE)

    relay.run(test)


def test_cancel_ends_a_pulse_at_once_and_for_good(relay: Bench[RelayBoard]) -> None:
    async def test(board: RelayBoard, twin: Twin) -> None:
        await board.pulse(Channel.VALVE, 3.0)
        await board.cancel(Channel.VALVE)
        assert not on(twin, Channel.VALVE)
        await asyncio.sleep(5.0)
        assert not on(twin, Channel.VALVE)

    relay.run(test)


def test_all_off_opens_every_coil(relay: Bench[RelayBoard]) -> None:
    async def test(board: RelayBoard, twin: Twin) -> None:
        await board.switch(Channel.LAMP, True)
        await board.pulse(Channel.VALVE, 3.0)
        await board.pulse(Channel.PUMP, 3.0)
        await board.all_off()
        assert not any(twin.coils(now()).values())

    relay.run(test)


def test_closing_switches_everything_off(relay: Bench[RelayBoard]) -> None:
    async def test(board: RelayBoard, twin: Twin) -> None:
        await board.pulse(Channel.PUMP, 20.0)
        await board.close()
        assert not any(twin.coils(now()).values())
        with pytest.raises(DeviceLost):
            await board.read()

    relay.run(test)


def test_read_back_shows_the_coils_as_they_are(relay: Bench[RelayBoard]) -> None:
    async def test(board: RelayBoard, twin: Twin) -> None:
        await board.pulse(Channel.PUMP, 1.0)
        state = await board.read()
        assert state.coils[Channel.PUMP]
        assert not state.coils[Channel.VALVE]
        assert set(state.coils) == board.channels
        assert 0.0 <= now() - state.stamp_s < 0.1

    relay.run(test)


def test_a_channel_that_is_not_wired_is_refused(relay: Bench[RelayBoard]) -> None:
    async def test(board: RelayBoard, twin: Twin) -> None:
        assert Channel.CONTACTOR not in board.channels
        with pytest.raises(DeviceRefused, match="contactor"):
            await board.switch(Channel.CONTACTOR, True)

    relay.run(test)


def test_a_cancelled_caller_leaves_the_pulse_to_the_boards_timer(relay: Bench[RelayBoard]) -> None:
    async def test(board: RelayBoard, twin: Twin) -> None:
        pulsing = asyncio.ensure_future(board.pulse(Channel.VALVE, 1.0))
        for _ in range(10_000):
            await asyncio.sleep(0.0005)
            if on(twin, Channel.VALVE):
                break
        pulsing.cancel()
        await asyncio.wait([pulsing])
        await asyncio.sleep(0.1)
        assert on(twin, Channel.VALVE)
        await asyncio.sleep(1.1)
        assert not on(twin, Channel.VALVE)

    relay.run(test)


def test_a_closing_command_is_obeyed_though_an_opening_one_was_given_up(relay: Bench[RelayBoard]) -> None:
    async def test(board: RelayBoard, twin: Twin) -> None:
        pulsing = asyncio.ensure_future(board.pulse(Channel.VALVE, 3.0))
        await asyncio.sleep(0.001)
        pulsing.cancel()
        await board.cancel(Channel.VALVE)
        await asyncio.sleep(0.1)
        assert not on(twin, Channel.VALVE)

    relay.run(test)


def test_requests_of_two_tasks_are_answered_one_after_the_other(relay: Bench[RelayBoard]) -> None:
    async def test(board: RelayBoard, twin: Twin) -> None:
        first, second = await asyncio.gather(board.pulse(Channel.PUMP, 1.0), board.pulse(Channel.VALVE, 1.0))
        assert second.sent_s >= first.accepted_s

    relay.run(test)


def test_a_silent_board_ends_in_a_timeout_and_its_timer_still_shuts_the_valve(relay: Bench[RelayBoard]) -> None:
    async def test(board: RelayBoard, twin: Twin) -> None:
        await asyncio.sleep(0.9 - now())
        await board.pulse(Channel.VALVE, 0.5)
        await asyncio.sleep(0.2)
        with pytest.raises(DeviceTimeout):
            await board.cancel(Channel.VALVE)
        await asyncio.sleep(0.5)
        assert not on(twin, Channel.VALVE)

    relay.run(test, "relay:off@1s")


def test_a_board_that_is_not_there_is_missing(relay: Bench[RelayBoard]) -> None:
    async def test(board: RelayBoard, twin: Twin) -> None:
        with pytest.raises(DeviceMissing):
            await board.open()

    relay.run(test, "relay:off", opened=False)


def test_a_garbled_answer_is_a_fault_though_the_command_was_obeyed(relay: Bench[RelayBoard]) -> None:
    async def test(board: RelayBoard, twin: Twin) -> None:
        await asyncio.sleep(1.0)
        with pytest.raises(DeviceFault, match="garbled"):
            await board.pulse(Channel.VALVE, 0.5)
        assert on(twin, Channel.VALVE)

    relay.run(test, "relay:garbage@1s")


def test_a_welded_contact_shows_in_the_read_back(relay: Bench[RelayBoard]) -> None:
    async def test(board: RelayBoard, twin: Twin) -> None:
        await board.pulse(Channel.VALVE, 2.0)
        await asyncio.sleep(1.0)
        await board.cancel(Channel.VALVE)
        assert (await board.read()).coils[Channel.VALVE]
        assert on(twin, Channel.VALVE)

    relay.run(test, "relay:stuck@0.5s")


def test_a_freed_contact_follows_the_last_command(relay: Bench[RelayBoard]) -> None:
    async def test(board: RelayBoard, twin: Twin) -> None:
        await board.pulse(Channel.VALVE, 10.0)
        await asyncio.sleep(1.0)
        await board.cancel(Channel.VALVE)
        await asyncio.sleep(3.0)
        assert not on(twin, Channel.VALVE)

    relay.run(test, "relay:stuck@0.5s+2s")


def test_a_slow_board_takes_several_times_as_long(relay: Bench[RelayBoard]) -> None:
    async def quickest_s(board: RelayBoard) -> float:
        took_s = []
        for _ in range(5):
            start_s = now()
            await board.read()
            took_s.append(now() - start_s)
        return min(took_s)

    async def test(board: RelayBoard, twin: Twin) -> None:
        quick_s = await quickest_s(board)
        await asyncio.sleep(2.0 - now())
        assert await quickest_s(board) > 3.0 * quick_s

    relay.run(test, "relay:slow@2s")


def test_about_every_other_opening_of_an_intermittent_line_fails(relay: Bench[RelayBoard]) -> None:
    async def test(board: RelayBoard, twin: Twin) -> None:
        await asyncio.sleep(1.0)
        failed = 0
        for _ in range(40):
            try:
                await board.pulse(Channel.BEACON, 0.1)
            except DeviceTimeout:
                failed += 1
        assert 8 <= failed <= 32

    relay.run(test, "relay:intermittent@1s")


def test_the_valve_coil_reads_the_other_way_round_when_the_board_is_wrong(relay: Bench[RelayBoard]) -> None:
    async def test(board: RelayBoard, twin: Twin) -> None:
        await asyncio.sleep(1.0)
        state = await board.read()
        assert dict(state.coils) != twin.coils(now())

    relay.run(test, "relay:wrong@1s")


def test_a_late_frame_takes_effect_after_its_answer_and_never_after_a_later_one(relay: Bench[RelayBoard]) -> None:
    async def test(board: RelayBoard, twin: Twin) -> None:
        await asyncio.sleep(1.0)
        await board.pulse(Channel.VALVE, 5.0)
        assert not on(twin, Channel.VALVE)
        await asyncio.sleep(0.5)
        assert on(twin, Channel.VALVE)
        await board.cancel(Channel.VALVE)
        await asyncio.sleep(0.5)
        assert not on(twin, Channel.VALVE)

    relay.run(test, "relay:delayed@1s")

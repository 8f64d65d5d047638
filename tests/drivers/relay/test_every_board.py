"""What a board of every profile does with the driver, judged by the coils of the twin."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

from drivers.errors import DeviceLost, DeviceRefused
from drivers.relay.profiles import PROFILES
from drivers.relay.values import BoardCapability, Channel, refusal_for_automatic
from tests.drivers.relay.boards import TIMED, WATCHED, Bench, on_board, until

PULSING = [*TIMED, *WATCHED]
KINDS = ["waveshare-8", "lc-8", "r4d8a08", "ryn408f", "wb-mr6"]  # the other boards differ by their channels only


async def stays_off(bench: Bench, for_s: float) -> None:
    for _ in range(round(for_s / 0.1)):
        assert not any(bench.twin.coils(bench.clock()).values())
        await asyncio.sleep(0.1)


@pytest.mark.parametrize("profile", PULSING)
def test_a_pulse_ends_by_itself(profile: str) -> None:
    async def test(bench: Bench) -> None:
        receipt = await bench.relay.pulse(Channel.VALVE, 0.5)
        assert bench.on()
        await asyncio.sleep(receipt.sent_s + receipt.duration_s - bench.clock() - 0.02)
        assert bench.on()
        await asyncio.sleep(receipt.accepted_s + receipt.duration_s - bench.clock() + 0.2)
        assert not bench.on()

    on_board(profile, test)


@pytest.mark.parametrize("profile", PULSING)
def test_a_cancelled_pulse_is_over_at_once_and_for_good(profile: str) -> None:
    async def test(bench: Bench) -> None:
        await bench.relay.pulse(Channel.VALVE, 5.0)
        await asyncio.sleep(0.1)
        await bench.relay.cancel(Channel.VALVE)
        await stays_off(bench, 6.0)

    on_board(profile, test)


@pytest.mark.parametrize("profile", PULSING)
def test_all_off_ends_every_pulse_and_every_lamp(profile: str) -> None:
    async def test(bench: Bench) -> None:
        await bench.relay.pulse(Channel.VALVE, 5.0)
        await bench.relay.pulse(Channel.PUMP, 5.0)
        await bench.relay.switch(Channel.LAMP, True)
        assert all(bench.on(channel) for channel in (Channel.VALVE, Channel.PUMP, Channel.LAMP))
        await bench.relay.all_off()
        await stays_off(bench, 6.0)

    on_board(profile, test)


@pytest.mark.parametrize("profile", PROFILES)
def test_a_lamp_is_switched_and_read_back(profile: str) -> None:
    async def test(bench: Bench) -> None:
        await bench.relay.switch(Channel.BEACON, True)
        await asyncio.sleep(3.0)
        state = await bench.relay.read()
        assert bench.on(Channel.BEACON)
        assert [channel for channel, on in state.coils.items() if on] == [Channel.BEACON]
        await bench.relay.switch(Channel.BEACON, False)
        assert not bench.on(Channel.BEACON)

    on_board(profile, test)


@pytest.mark.parametrize("profile", TIMED)
def test_a_lamp_stays_on_though_a_pulse_ran_on_it_before(profile: str) -> None:
    async def test(bench: Bench) -> None:
        await bench.relay.pulse(Channel.LAMP, 1.0)
        await bench.relay.switch(Channel.LAMP, True)
        await asyncio.sleep(3.0)
        assert bench.on(Channel.LAMP)

    on_board(profile, test)


@pytest.mark.parametrize("profile", PULSING)
def test_after_a_power_cut_everything_is_off_and_the_next_pulse_runs(profile: str) -> None:
    async def test(bench: Bench) -> None:
        await bench.relay.pulse(Channel.VALVE, 1.0)
        bench.bus.board.power_cycle()
        assert not bench.on()
        assert not (await bench.relay.read()).coils[Channel.VALVE]
        await bench.relay.pulse(Channel.VALVE, 0.3)
        assert bench.on()
        await asyncio.sleep(2.0)
        assert not bench.on()

    on_board(profile, test)


@pytest.mark.parametrize("profile", KINDS)
def test_a_host_that_falls_silent_in_a_long_pulse_shuts_within_one_lease(profile: str) -> None:
    async def test(bench: Bench) -> None:
        limit_s = bench.relay.capability.watchdog_s or bench.settings.lease_s
        await bench.relay.pulse(Channel.VALVE, 20.0)
        await asyncio.sleep(0.7 * limit_s)
        assert bench.on()
        bench.bus.wire.unplug()
        await asyncio.sleep(limit_s + 0.3)
        assert not bench.on()

    on_board(profile, test)


@pytest.mark.parametrize("profile", KINDS)
def test_a_pulse_longer_than_a_lease_lasts_to_its_end_and_no_longer(profile: str) -> None:
    async def test(bench: Bench) -> None:
        length_s = 2.5 * (bench.relay.capability.watchdog_s or bench.settings.lease_s)
        receipt = await bench.relay.pulse(Channel.VALVE, length_s)
        while bench.clock() < receipt.sent_s + receipt.duration_s - 0.05:
            assert bench.on()
            await asyncio.sleep(0.05)
        await asyncio.sleep(receipt.accepted_s + receipt.duration_s - bench.clock() + 0.2)
        assert not bench.on()

    on_board(profile, test)


@pytest.mark.parametrize("profile", PROFILES)
def test_a_board_that_comes_back_is_identified_before_it_is_switched_off(profile: str, tmp_path: Path) -> None:
    async def test(bench: Bench) -> None:
        await bench.relay.switch(Channel.LAMP, True)
        bench.bus.wire.unplug()
        with pytest.raises(DeviceLost):
            await bench.relay.read()
        seen = len(bench.trace.requests())
        bench.bus.wire.plug()
        await until(lambda: bench.port.connected)
        assert not bench.on(Channel.LAMP)
        functions = [frame[1] for frame in bench.trace.requests()[seen:]]
        probes = len(PROFILES[profile].probes)
        assert all(function <= 4 for function in functions[:probes])
        assert any(function > 4 for function in functions[probes:])

    on_board(profile, test, link=tmp_path / "relay")


def test_a_board_that_can_do_neither_gives_no_pulse_and_says_why() -> None:
    async def test(bench: Bench) -> None:
        assert bench.relay.capability.pulse_max_s == 0.0
        assert bench.relay.capability.watchdog_s is None
        with pytest.raises(DeviceRefused, match="neither time a pulse nor watch the line"):
            await bench.relay.pulse(Channel.VALVE, 0.5)
        assert not bench.on()

    on_board("generic-coils", test)


@pytest.mark.parametrize("profile", PROFILES)
def test_only_a_board_that_shuts_without_the_host_may_work_unattended(profile: str) -> None:
    async def test(bench: Bench) -> None:
        refusal = refusal_for_automatic(bench.relay.capability)
        assert (refusal is None) == (profile != "generic-coils")

    on_board(profile, test, opened=False)


def test_a_watchdog_that_comes_too_late_is_refused() -> None:
    assert refusal_for_automatic(BoardCapability(0.001, 30.0, 5.0, host_timed=True)) is None
    assert "watchdog to 5 s" in (refusal_for_automatic(BoardCapability(0.001, 30.0, 60.0, host_timed=True)) or "")


def test_the_watchdog_is_armed_and_the_coils_stay_off_at_power_on() -> None:
    async def test(bench: Bench) -> None:
        bench.bus.board.held[6] = 1  # type: ignore[union-attr]
        await bench.relay.open()
        assert bench.bus.board.held == {6: 0, 8: 2}  # type: ignore[union-attr]
        assert bench.relay.capability.watchdog_s == 2.0

    on_board("wb-mr6", test, opened=False, watchdog_s=1.5)

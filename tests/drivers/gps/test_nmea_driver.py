"""The production driver on the emulated receiver."""

from __future__ import annotations

import asyncio
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from itertools import pairwise

import pytest

from drivers.errors import DeviceLost
from drivers.gps.emulator import FIXED_FOR_S, FLOAT_FOR_S
from drivers.gps.nmea import NmeaGps
from drivers.gps.rtcm import frame
from drivers.gps.values import FixQuality
from drivers.twin import Twin
from drivers.twin import commands as c
from drivers.twin.bus import STALE_S
from drivers.twin.receiver import OUTPUT_DELAY_S
from tests.contract.rigged import Rigged
from tests.contract.rigs.gps import SENDS
from tests.drivers.gps.rig import lost, now, run


@pytest.mark.parametrize("rate_hz", [1.0, 2.0, 10.0, 20.0])
def test_every_epoch_comes_at_every_rate(rate_hz: float) -> None:
    async def test(rigged: Rigged[NmeaGps], twin: Twin) -> None:
        fixes = [await rigged.device.next_fix() for _ in range(14)][4:]
        steps = [b.utc - a.utc for a, b in pairwise(fixes) if a.utc and b.utc]
        assert [step.total_seconds() for step in steps] == pytest.approx([1.0 / rate_hz] * 9)
        assert {fix.quality for fix in fixes} == {FixQuality.RTK_FIXED}

    run(test, gps_rate_hz=rate_hz)


def test_a_fix_is_stamped_with_its_epoch() -> None:
    """The twin's epochs are at whole fifths of a second of the loop's clock."""

    async def test(rigged: Rigged[NmeaGps], twin: Twin) -> None:
        fixes = [await rigged.device.next_fix() for _ in range(10)]
        apart = [fix.stamp_s - 0.2 * round(fix.stamp_s / 0.2) for fix in fixes[2:]]
        assert apart == pytest.approx([0.0] * 8, abs=0.02)

    run(test)


def test_the_fix_tells_what_the_twin_told() -> None:
    async def test(rigged: Rigged[NmeaGps], twin: Twin) -> None:
        fix = await rigged.device.next_fix()
        true = twin.fix(now())
        assert fix.latitude_deg == pytest.approx(true.latitude_deg, abs=1e-6)
        assert fix.longitude_deg == pytest.approx(true.longitude_deg, abs=1e-6)
        assert fix.altitude_m == pytest.approx(true.altitude_m, abs=0.1)
        assert (fix.satellites, fix.hdop) == (true.satellites, true.hdop)
        assert fix.accuracy_m == pytest.approx(true.accuracy_m, abs=0.001)
        assert fix.utc is not None
        assert fix.utc.microsecond % 200_000 == 0

    run(test)


def test_once_the_end_of_the_burst_is_known_a_fix_comes_without_waiting_for_silence() -> None:
    async def test(rigged: Rigged[NmeaGps], twin: Twin) -> None:
        device = rigged.device
        for _ in range(6):
            await device.next_fix()
        lags = []
        for _ in range(5):
            fix = await device.next_fix()
            lags.append(now() - fix.stamp_s)
        # 464 bytes at 115200 baud take 40 ms; silence would cost 100 ms more
        assert min(lags) < OUTPUT_DELAY_S + 0.040 + 0.060

    run(test)


def test_the_first_fix_after_opening_is_not_of_half_a_burst() -> None:
    async def test(rigged: Rigged[NmeaGps], twin: Twin) -> None:
        first = await rigged.device.next_epoch()
        assert first.whole
        assert (first.quality, first.satellites) == (FixQuality.RTK_FIXED, 18)
        assert first.correction_age_s is None

    run(test)


def test_late_sentences_keep_the_stamp_of_their_epoch() -> None:
    async def test(rigged: Rigged[NmeaGps], twin: Twin) -> None:
        await asyncio.sleep(5.5)
        for _ in range(3):
            fix = await rigged.device.next_fix()
            assert now() - fix.stamp_s > STALE_S

    run(test, "gps:delayed@3s")


def test_a_lost_sentence_here_and_there_does_not_stop_the_fixes() -> None:
    async def test(rigged: Rigged[NmeaGps], twin: Twin) -> None:
        await asyncio.sleep(1.0)
        fixes = [await rigged.device.next_fix() for _ in range(10)]
        assert all(b.stamp_s > a.stamp_s for a, b in pairwise(fixes))
        assert FixQuality.RTK_FIXED in {fix.quality for fix in fixes}

    run(test, "gps:intermittent@1s")


@pytest.mark.parametrize("year", [2006, 2019])
def test_a_week_count_that_rolled_over_costs_the_time_and_not_the_position(year: int) -> None:
    """F42."""

    async def test(rigged: Rigged[NmeaGps], twin: Twin) -> None:
        epoch = await rigged.device.next_epoch()
        fix = await rigged.device.next_fix()
        assert epoch.utc is not None
        assert epoch.utc.year == year
        assert fix.utc is None
        assert fix.quality is FixQuality.RTK_FIXED
        assert fix.latitude_deg == pytest.approx(twin.nominal.gps_latitude_deg, abs=1e-5)

    run(test, start_utc=datetime(year, 10, 1, tzinfo=UTC))


def test_fixes_go_on_over_midnight() -> None:
    async def test(rigged: Rigged[NmeaGps], twin: Twin) -> None:
        fixes = [await rigged.device.next_fix() for _ in range(20)]
        days = [fix.utc.day for fix in fixes if fix.utc is not None]
        assert days == sorted(days)
        assert set(days) == {15, 16}
        assert [b.stamp_s - a.stamp_s for a, b in pairwise(fixes[2:])] == pytest.approx([0.2] * 17, abs=0.03)

    run(test, start_utc=datetime(2026, 6, 15, 23, 59, 58, tzinfo=UTC))


def test_an_unplugged_receiver_is_lost() -> None:
    async def test(rigged: Rigged[NmeaGps], twin: Twin) -> None:
        (wire,) = rigged.wires
        await rigged.device.next_fix()
        wire.unplug()
        await lost(rigged.device)
        with pytest.raises(DeviceLost, match="plug it in again"):
            await rigged.device.next_fix()

    run(test)


def test_a_waiting_caller_learns_that_the_receiver_was_closed() -> None:
    async def test(rigged: Rigged[NmeaGps], twin: Twin) -> None:
        waiting = asyncio.create_task(rigged.device.next_fix())
        await asyncio.sleep(0.0)
        await asyncio.sleep(0.0)
        await rigged.device.close()
        with pytest.raises(DeviceLost):
            await waiting

    run(test, gps_rate_hz=1.0)


def test_two_callers_get_the_same_fix() -> None:
    async def test(rigged: Rigged[NmeaGps], twin: Twin) -> None:
        one, two = await asyncio.gather(rigged.device.next_fix(), rigged.device.next_fix())
        assert one == two

    run(test)


def test_corrections_reach_the_receiver_and_make_its_fix() -> None:
    async def test(rigged: Rigged[NmeaGps], twin: Twin) -> None:
        device = rigged.device
        assert (await device.next_fix()).quality is FixQuality.SINGLE
        await device.correct(frame(b"\x3e\xd0" + bytes(17)))
        qualities = [(await device.next_fix()).quality for _ in range(3)]
        assert qualities[-1] is FixQuality.RTK_FIXED
        epoch = await device.next_epoch()
        assert epoch.correction_age_s == pytest.approx(0.8, abs=0.5)

    run(test, receiver=replace(SENDS, needs_corrections=True))


def test_without_corrections_rtk_falls_to_float_and_then_to_single() -> None:
    async def test(rigged: Rigged[NmeaGps], twin: Twin) -> None:
        device = rigged.device
        await device.correct(frame(b"\x3e\xd0" + bytes(17)))
        corrected_s = now()
        for wait_s, quality in (
            (FIXED_FOR_S - 3.0, FixQuality.RTK_FIXED),
            (FIXED_FOR_S + 1.0, FixQuality.RTK_FLOAT),
            (FLOAT_FOR_S - 3.0, FixQuality.RTK_FLOAT),
            (FLOAT_FOR_S + 1.5, FixQuality.SINGLE),
        ):
            await asyncio.sleep(corrected_s + wait_s - now())
            await device.next_fix()
            fix = await device.next_fix()
            assert fix.quality is quality
            assert fix.accuracy_m is not None
        assert fix.accuracy_m > 1.0

    run(test, receiver=replace(SENDS, needs_corrections=True), gps_rate_hz=1.0)


def test_garbled_corrections_do_not_count() -> None:
    async def test(rigged: Rigged[NmeaGps], twin: Twin) -> None:
        broken = bytearray(frame(b"\x3e\xd0" + bytes(17)))
        broken[7] ^= 1
        await rigged.device.correct(bytes(broken))
        assert {(await rigged.device.next_fix()).quality for _ in range(4)} == {FixQuality.SINGLE}

    run(test, receiver=replace(SENDS, needs_corrections=True))


def test_surroundings_change_the_quality() -> None:
    async def test(rigged: Rigged[NmeaGps], twin: Twin) -> None:
        twin.apply(now(), c.WorldGpsQuality(int(FixQuality.DGPS)))
        await rigged.device.next_fix()
        fix = await rigged.device.next_fix()
        assert fix.quality is FixQuality.DGPS

    run(test)


def test_a_receiver_whose_wire_is_too_slow_drops_epochs_and_does_not_fall_behind() -> None:
    """464 bytes take 480 ms at 9600 baud: two epochs a second instead of five, none older than two bursts."""

    async def test(rigged: Rigged[NmeaGps], twin: Twin) -> None:
        await asyncio.sleep(10.0)
        fixes = [await rigged.device.next_fix() for _ in range(6)]
        assert now() - fixes[-1].stamp_s < 2.5
        assert all(b.utc - a.utc > timedelta(seconds=0.2) for a, b in pairwise(fixes) if a.utc and b.utc)
        assert (fixes[-1].stamp_s - fixes[0].stamp_s) / 5 == pytest.approx(0.48, abs=0.13)

    run(test, receiver=replace(SENDS, baud=9600))

"""What every receiver keeps, judged by where the base of the twin truly is."""

from __future__ import annotations

import asyncio
import math
from itertools import pairwise

import pytest

from drivers.errors import DeviceFault, DeviceLost, DeviceMissing, DeviceTimeout
from drivers.gps.interface import Gps
from drivers.gps.values import Fix, FixQuality
from drivers.twin import Nominal, Twin
from drivers.twin import commands as c
from tests.contract.conftest import Bench

METRES_A_DEGREE = 111_200.0  # of latitude, to 0.2 %


def now() -> float:
    return asyncio.get_running_loop().time()


async def fix_of_later(device: Gps, than_s: float) -> Fix:
    """A fix of an epoch after that time. What completes after a call may be of an epoch shortly before it."""
    while (fix := await device.next_fix()).stamp_s <= than_s:
        pass
    return fix


def north_m(fix: Fix, nominal: Nominal) -> float:
    assert fix.latitude_deg is not None
    return (fix.latitude_deg - nominal.gps_latitude_deg) * METRES_A_DEGREE


def east_m(fix: Fix, nominal: Nominal) -> float:
    assert fix.longitude_deg is not None
    shrink = math.cos(math.radians(nominal.gps_latitude_deg))
    return (fix.longitude_deg - nominal.gps_longitude_deg) * METRES_A_DEGREE * shrink


def test_a_fix_completes_after_the_call(gps: Bench[Gps]) -> None:
    async def test(device: Gps, twin: Twin) -> None:
        called_s = now()
        fix = await device.next_fix()
        assert called_s - 0.2 < fix.stamp_s <= now()
        assert (await device.next_fix()).stamp_s > called_s

    gps.run(test)


def test_fixes_come_at_the_receivers_rate(gps: Bench[Gps]) -> None:
    async def test(device: Gps, twin: Twin) -> None:
        stamps = [(await device.next_fix()).stamp_s for _ in range(8)][2:]
        assert [b - a for a, b in pairwise(stamps)] == pytest.approx([0.2] * 5, abs=0.03)

    gps.run(test)


def test_a_fixed_solution_is_good_to_centimetres(gps: Bench[Gps]) -> None:
    async def test(device: Gps, twin: Twin) -> None:
        fixes = [await device.next_fix() for _ in range(20)]
        assert {fix.quality for fix in fixes} == {FixQuality.RTK_FIXED}
        assert all(math.hypot(north_m(f, twin.nominal), east_m(f, twin.nominal)) < 0.06 for f in fixes)
        assert len({fix.latitude_deg for fix in fixes}) >= 15  # tenths of a millimetre on the wire

    gps.run(test)


def test_the_fix_follows_the_base_along_the_rows_heading(gps: Bench[Gps]) -> None:
    async def test(device: Gps, twin: Twin) -> None:
        pushed_s = now()
        twin.apply(pushed_s, c.WorldPush(2.0, 0.5, 0.0))
        fix = await fix_of_later(device, pushed_s)
        assert east_m(fix, twin.nominal) == pytest.approx(2.0, abs=0.06)
        assert north_m(fix, twin.nominal) == pytest.approx(0.5, abs=0.06)

    gps.run(test, gps_row_heading_rad=0.5 * math.pi)


@pytest.mark.parametrize("quality", [FixQuality.SINGLE, FixQuality.DGPS, FixQuality.RTK_FLOAT])
def test_the_claimed_accuracy_fits_the_error(gps: Bench[Gps], quality: FixQuality) -> None:
    async def test(device: Gps, twin: Twin) -> None:
        fixes = []
        for _ in range(20):
            fixes.append(await device.next_fix())
            await asyncio.sleep(10.0)
        errors = [math.hypot(north_m(f, twin.nominal), east_m(f, twin.nominal)) for f in fixes]
        rms = math.sqrt(sum(e * e for e in errors) / 2 / len(errors))
        claimed = fixes[0].accuracy_m
        assert claimed is not None
        assert 0.5 * claimed < rms < 2.0 * claimed

    gps.run(test, gps_quality=quality, gps_rate_hz=1.0)


def test_without_a_position_there_is_a_fix_of_quality_none(gps: Bench[Gps]) -> None:
    async def test(device: Gps, twin: Twin) -> None:
        fix = await device.next_fix()
        assert fix.quality is FixQuality.NONE
        assert fix.latitude_deg is fix.longitude_deg is fix.accuracy_m is None

    gps.run(test, gps_quality=FixQuality.NONE)


def test_utc_goes_with_the_stamp(gps: Bench[Gps]) -> None:
    async def test(device: Gps, twin: Twin) -> None:
        first = await device.next_fix()
        await asyncio.sleep(7.0)
        second = await device.next_fix()
        assert first.utc is not None
        assert second.utc is not None
        assert (second.utc - first.utc).total_seconds() == pytest.approx(second.stamp_s - first.stamp_s, abs=0.05)
        assert first.utc.tzinfo is not None

    gps.run(test)


def test_course_is_known_while_moving_only(gps: Bench[Gps]) -> None:
    async def test(device: Gps, twin: Twin) -> None:
        assert (await device.next_fix()).course_rad is None
        for _ in range(20):
            twin.apply(now(), c.WheelsDrive(0.3, 0.0))
            await asyncio.sleep(0.1)
        fix = await fix_of_later(device, now() - 0.3)
        assert fix.course_rad == pytest.approx(1.0, abs=0.1)
        assert fix.speed_m_s == pytest.approx(0.3, abs=0.05)

    gps.run(test, gps_row_heading_rad=1.0)


def test_a_silent_receiver_ends_in_a_timeout(gps: Bench[Gps]) -> None:
    async def test(device: Gps, twin: Twin) -> None:
        await asyncio.sleep(1.0)
        start_s = now()
        with pytest.raises(DeviceTimeout):
            await device.next_fix()
        assert 0.5 < now() - start_s < 10.0

    gps.run(test, "gps:off@1s")


def test_an_absent_receiver_is_missing(gps: Bench[Gps]) -> None:
    async def test(device: Gps, twin: Twin) -> None:
        with pytest.raises(DeviceMissing):
            await device.open()

    gps.run(test, "gps:off", opened=False)


def test_a_closed_receiver_is_lost(gps: Bench[Gps]) -> None:
    async def test(device: Gps, twin: Twin) -> None:
        await device.close()
        with pytest.raises(DeviceLost):
            await device.next_fix()

    gps.run(test)


def test_garbled_sentences_are_a_fault(gps: Bench[Gps]) -> None:
    async def test(device: Gps, twin: Twin) -> None:
        await asyncio.sleep(1.0)
        with pytest.raises(DeviceFault):
            await device.next_fix()

    gps.run(test, "gps:garbage@1s")


def test_multipath_shifts_the_position_by_metres(gps: Bench[Gps]) -> None:
    async def test(device: Gps, twin: Twin) -> None:
        await asyncio.sleep(1.0)
        assert east_m(await fix_of_later(device, 1.0), twin.nominal) == pytest.approx(3.0, abs=0.1)

    gps.run(test, "gps:wrong@1s")


def test_a_frozen_receiver_repeats_its_place(gps: Bench[Gps]) -> None:
    async def test(device: Gps, twin: Twin) -> None:
        await asyncio.sleep(1.0)
        first = await fix_of_later(device, 1.0)
        pushed_s = now()
        twin.apply(pushed_s, c.WorldPush(1.0, 0.0, 0.0))
        second = await fix_of_later(device, pushed_s)
        assert second.latitude_deg == first.latitude_deg
        assert second.stamp_s > first.stamp_s

    gps.run(test, "gps:stuck@1s")


def test_two_antennas_tell_where_the_base_points(gps: Bench[Gps]) -> None:
    async def test(device: Gps, twin: Twin) -> None:
        assert (await device.next_fix()).heading_rad == pytest.approx(1.0, abs=0.02)
        turned_s = now()
        twin.apply(turned_s, c.WorldPush(0.0, 0.0, 0.5))
        assert (await fix_of_later(device, turned_s)).heading_rad == pytest.approx(0.5, abs=0.02)

    gps.run(test, gps_row_heading_rad=1.0, gps_two_antennas=True)


def test_one_antenna_tells_no_heading(gps: Bench[Gps]) -> None:
    async def test(device: Gps, twin: Twin) -> None:
        assert (await device.next_fix()).heading_rad is None

    gps.run(test)

"""Sentences of one moment belong together."""

from __future__ import annotations

from datetime import UTC, datetime

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.gps.epochs import LEARNED_AFTER, Epoch, EpochAssembler
from drivers.gps.nmea_sentences import Sentence, checksum, parse
from drivers.gps.values import FixQuality

PLACE = "4739.6000000,N,00910.5000000,E"


def read(body: str) -> Sentence:
    return parse(f"${body}*{checksum(body):02X}".encode())


def gga(time: str, quality: int = 4, satellites: int = 18, height: str = "404.0") -> Sentence:
    return read(f"GNGGA,{time},{PLACE},{quality},{satellites:02d},0.7,{height},M,48.0,M,1.0,0001")


def rmc(time: str, day: str = "150626", status: str = "A", letter: str = "R", place: str = PLACE) -> Sentence:
    return read(f"GNRMC,{time},{status},{place},0.583,57.3,{day},,,{letter},V")


def gsa(mode: int, talker: str = "GN") -> Sentence:
    return read(f"{talker}GSA,A,{mode},02,05,07,,,,,,,,,,1.2,0.7,0.9")


def gathered(*sentences: Sentence, learn: bool = False) -> list[Epoch]:
    assembler = EpochAssembler(learn)
    return [epoch for s in sentences for epoch in assembler.add(s)] + assembler.quiet()


def test_an_epoch_joins_what_its_sentences_say() -> None:
    (epoch,) = gathered(
        rmc("100000.20"), gga("100000.20"), gsa(3), read("GNGST,100000.20,,,,,0.006,0.008,0.015"), read("GNHDT,57.5,T")
    )
    assert epoch.utc == datetime(2026, 6, 15, 10, 0, 0, 200_000, UTC)
    assert (epoch.quality, epoch.mode, epoch.satellites) == (FixQuality.RTK_FIXED, 3, 18)
    assert (epoch.latitude_deg, epoch.longitude_deg) == (pytest.approx(47.66), pytest.approx(9.175))
    assert epoch.accuracy_m == pytest.approx(0.00707, abs=1e-5)
    assert epoch.speed_m_s == pytest.approx(0.3, abs=1e-3)
    assert (epoch.course_deg, epoch.heading_deg, epoch.correction_age_s) == (57.3, 57.5, 1.0)


def test_an_epoch_ends_where_the_time_changes() -> None:
    epochs = gathered(rmc("100000.00"), gga("100000.00"), rmc("100000.10"), gga("100000.10"))
    assert [epoch.utc.microsecond for epoch in epochs if epoch.utc] == [0, 100_000]


def test_a_receiver_without_a_clock_has_epochs_too() -> None:
    nothing = [read("GPRMC,,V,,,,,,,,,,N"), read("GPGGA,,,,,,0,00,99.99,,,,,,"), gsa(1)]
    epochs = gathered(*nothing * 3)
    assert [(epoch.quality, epoch.mode, epoch.utc) for epoch in epochs] == [(FixQuality.NONE, 1, None)] * 3


def test_a_clock_that_stands_still_does_not_join_epochs() -> None:
    assert len(gathered(*[gga("100000.00")] * 4)) == 4


def test_the_same_sentence_of_two_talkers_is_one_epoch() -> None:
    (epoch,) = gathered(
        read(f"GPGGA,100000.00,{PLACE},1,05,1.3,250.7,M,50.0,M,,"),
        read(f"GAGGA,100000.00,{PLACE},1,01,1.3,250.7,M,50.0,M,,"),
    )
    assert epoch.quality is FixQuality.SINGLE


def test_any_sentence_that_warns_takes_the_position_away() -> None:
    warnings = [
        [rmc("100000.00", status="V"), gga("100000.00")],
        [rmc("100000.00"), gga("100000.00", quality=0)],
        [rmc("100000.00"), read(f"GPGGA,100000.00,{PLACE},,08,0.9,545.4,M,46.9,M,,")],
        [rmc("100000.00"), gga("100000.00"), gsa(1)],
    ]
    for sentences in warnings:
        (epoch,) = gathered(*sentences)
        assert (epoch.quality, epoch.mode) == (FixQuality.NONE, 1)
        assert epoch.latitude_deg is epoch.longitude_deg is epoch.altitude_m is epoch.accuracy_m is None
        assert epoch.speed_m_s is epoch.course_deg is None


def test_one_system_without_satellites_does_not_take_the_fix_away() -> None:
    (epoch,) = gathered(rmc("100000.00"), gga("100000.00"), gsa(3, "GP"), gsa(1, "BD"))
    assert (epoch.quality, epoch.mode) == (FixQuality.RTK_FIXED, 3)


def test_a_place_that_makes_no_sense_is_no_fix() -> None:
    bad = "4739.6,X,00910.5,E"
    (epoch,) = gathered(rmc("100000.00", place=bad), read(f"GNGGA,100000.00,{bad},1,04,2.6,100.0,M,-33.9,M,,"))
    assert epoch.quality is FixQuality.NONE


@pytest.mark.parametrize(
    ("quality", "letter"),
    [(FixQuality.SINGLE, "A"), (FixQuality.DGPS, "D"), (FixQuality.RTK_FLOAT, "F"), (FixQuality.RTK_FIXED, "R")],
)
def test_a_receiver_of_rmc_only_tells_its_quality_by_letter(quality: FixQuality, letter: str) -> None:
    (epoch,) = gathered(rmc("100000.00", letter=letter))
    assert (epoch.quality, epoch.mode) == (quality, 2)


def test_without_gst_the_accuracy_follows_from_quality_and_geometry() -> None:
    accuracies = [gathered(gga("100000.00", quality=digit))[0].accuracy_m or 0.0 for digit in (4, 5, 2, 1)]
    assert accuracies == sorted(accuracies)
    assert accuracies[0] < 0.05 < 1.0 < accuracies[-1]
    (wide,) = gathered(read(f"GNGGA,100000.00,{PLACE},1,04,4.0,404.0,M,48.0,M,,"))
    assert wide.accuracy_m == pytest.approx(4.0 * accuracies[-1])


def test_the_mode_is_remembered_for_a_while_where_gsa_is_rare() -> None:
    flat = [rmc("100000.00"), gsa(2), rmc("100001.00"), rmc("100009.00"), rmc("100012.00"), rmc("100013.00")]
    assert [epoch.mode for epoch in gathered(gga("095959.00"), *flat)] == [3, 2, 2, 2, 2, 2]
    high = [gga("100000.00"), rmc("100001.00"), rmc("100009.00"), rmc("100012.00")]
    assert [epoch.mode for epoch in gathered(*high)] == [3, 3, 3, 2]


def test_the_date_is_carried_over_midnight() -> None:
    epochs = gathered(rmc("235959.50", "311226"), gga("235959.75"), gga("000000.00"), gga("000000.25"))
    assert [f"{epoch.utc:%y-%m-%d %H%M%S}" for epoch in epochs] == [
        "26-12-31 235959", "26-12-31 235959", "27-01-01 000000", "27-01-01 000000",
    ]  # fmt: skip


def test_a_leap_second_is_an_epoch_of_its_own() -> None:
    epochs = gathered(rmc("235959.00", "311226"), rmc("235960.00", "311226"), rmc("000000.00", "010127"))
    assert [epoch.day_s for epoch in epochs] == [86_399.0, 86_400.0, 0.0]


def test_without_a_date_there_is_no_utc() -> None:
    assert gathered(gga("100000.00"))[0].utc is None


def test_a_malformed_date_is_not_replaced_by_the_last_good_one() -> None:
    assert [e.utc for e in gathered(rmc("100000.00"), rmc("100001.00", "2208-1"))][1] is None


def test_the_date_may_come_in_the_last_sentence_of_the_epoch() -> None:
    (epoch,) = gathered(gga("100000.00"), read("GNZDA,100000.00,15,06,2026,00,00"))
    assert epoch.utc == datetime(2026, 6, 15, 10, tzinfo=UTC)


# --- when an epoch is complete


def cycle(second: int) -> list[Sentence]:
    return [rmc(f"1000{second:02d}.00"), gga(f"1000{second:02d}.00"), gsa(3), gsa(3)]


def test_the_end_of_the_cycle_is_learnt() -> None:
    assembler = EpochAssembler(learn=True)
    for second in range(LEARNED_AFTER + 1):
        for sentence in cycle(second):
            assembler.add(sentence)
    assembler.quiet()
    *first, last = cycle(30)
    assert [epoch for sentence in first for epoch in assembler.add(sentence)] == []
    (epoch,) = assembler.add(last)
    assert epoch.day_s == 36_030.0


def test_a_cycle_that_grows_is_learnt_anew_and_gives_no_epoch_twice() -> None:
    assembler = EpochAssembler(learn=True)
    seconds: list[float | None] = []
    for second in range(40):
        more = [read(f"GNGST,1000{second:02d}.00,,,,,0.006,0.008,0.015")] if second >= 10 else []
        for sentence in cycle(second) + more:
            seconds += [epoch.day_s for epoch in assembler.add(sentence)]
    assert seconds == sorted(set(seconds), key=seconds.index)
    assert len(seconds) >= 39
    assembler.quiet()
    got = [epoch for s in [*cycle(50), read("GNGST,100050.00,,,,,0.006,0.008,0.015")] for epoch in assembler.add(s)]
    assert [epoch.accuracy_m for epoch in got] == [pytest.approx(0.00707, abs=1e-5)]


def test_silence_completes_an_epoch() -> None:
    assembler = EpochAssembler(learn=True)
    assert [epoch for sentence in cycle(0) for epoch in assembler.add(sentence)] == []
    assert len(assembler.quiet()) == 1
    assert assembler.quiet() == []


def test_gsa_before_the_time_belongs_to_what_follows_once_the_end_is_known() -> None:
    assembler = EpochAssembler(learn=True)
    modes: list[int] = []
    for second in range(12):
        fixed = second % 2
        burst = [
            gsa(3 if fixed else 2), rmc(f"1000{second:02d}.00"), read(f"GNGLL,{PLACE},1000{second:02d}.00,A,R"),
        ]  # fmt: skip
        for sentence in burst:
            modes += [epoch.mode for epoch in assembler.add(sentence)]
        modes += [epoch.mode for epoch in assembler.quiet()]
    assert modes[-6:] == [2, 3, 2, 3, 2, 3]


def test_only_the_first_epoch_may_be_a_part() -> None:
    epochs = gathered(*cycle(0)[1:], *cycle(1), *cycle(2))
    assert [epoch.whole for epoch in epochs] == [False, True, True]


def test_after_a_silence_the_first_epoch_is_whole() -> None:
    assembler = EpochAssembler()
    assembler.quiet()
    assert [epoch.whole for s in [*cycle(0), *cycle(1)] for epoch in assembler.add(s)] == [True]


def test_an_epoch_began_with_its_first_sentence() -> None:
    assembler = EpochAssembler()
    for at_s, sentence in enumerate(cycle(0)):
        assembler.add(sentence, float(at_s))
    assert [epoch.began_s for epoch in assembler.quiet()] == [0.0]


kinds = st.sampled_from(
    [
        rmc, gga, lambda t: gsa(3), lambda t: gsa(1), lambda t: rmc(t, status="V"),
        lambda t: rmc(t, "310226"), lambda t: rmc("", ""), lambda t: read("GNVTG,,,,,,,,,N"),
        lambda t: read("GNHDT,400.0,T"), lambda t: read(f"GNZDA,{t},31,12,9999,,"), lambda t: gga(t, height=""),
    ]
)  # fmt: skip


@given(st.lists(st.tuples(kinds, st.integers(0, 90)), max_size=60), st.booleans())
def test_no_order_of_sentences_makes_an_epoch_that_contradicts_itself(steps, learn) -> None:  # type: ignore[no-untyped-def]
    sentences = [make(f"2359{second:02d}.00" if second < 61 else f"0000{second - 61:02d}.00") for make, second in steps]
    epochs = gathered(*sentences, learn=learn)
    assert len(epochs) <= len(sentences)
    for epoch in epochs:
        fixed = epoch.quality is not FixQuality.NONE
        assert fixed == (epoch.mode > 1) == (epoch.latitude_deg is not None) == (epoch.accuracy_m is not None)

"""What words mean, which frames are asked, and readings that are not believed."""

from __future__ import annotations

import math
import struct
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.errors import DeviceFault
from drivers.inputs.modbus import InputsSettings
from drivers.inputs.points import Block, Point, blocks, current_loop
from drivers.inputs.profiles import module_named, reference_modules, reference_points
from drivers.inputs.readings import COUNTS, Readings, Totaliser


def point(kind: Any = "u16", **more: Any) -> Point:
    told: dict[str, Any] = {"quantity": "pressure_bar", "unit_id": 2, "function": 4, "address": 0}
    return Point(kind=kind, **told | more)


@pytest.mark.parametrize(
    ("kind", "words", "raw"),
    [
        ("u16", [0xFFFF], 65535), ("i16", [0xFFFF], -1), ("i16", [0x7FFF], 32767),
        ("u32", [0x0001, 0x0002], 65538), ("u32_low_first", [0x0002, 0x0001], 65538),
        ("f32", list(struct.unpack(">HH", struct.pack(">f", 1.5))), 1.5),
        ("f32_low_first", list(struct.unpack(">HH", struct.pack(">f", -2.25)))[::-1], -2.25),
        ("counter", [0xFFFF, 0xFFFF], COUNTS - 1),
    ],
)  # fmt: skip
def test_words_become_the_number_of_their_kind(kind: str, words: list[int], raw: float) -> None:
    assert point(kind).raw(words) == raw


def test_the_reference_rig_is_polled_with_four_frames() -> None:
    assert blocks(reference_points(10_000.0, 5880.0)) == (
        Block(2, 4, 0, 3), Block(3, 2, 0, 2), Block(3, 4, 0, 3), Block(80, 3, 0x3D, 2),
    )  # fmt: skip


def test_a_poll_of_the_reference_rig_takes_less_than_thirty_milliseconds_on_the_wire() -> None:
    byte_s, silence_s, turnaround_s = 10.0 / 115200, 0.00175, 0.0015
    wire_s = 0.0
    for block in blocks(reference_points(10_000.0, 5880.0)):
        answer = 5 + ((block.count + 7) // 8 if block.function <= 2 else 2 * block.count)
        wire_s += (8 + answer) * byte_s + silence_s + turnaround_s
    assert wire_s < 0.030


PLACES = st.tuples(st.integers(1, 3), st.integers(3, 4), st.integers(0, 300), st.booleans())


@given(st.lists(PLACES, min_size=1, max_size=12))
def test_every_point_lies_in_a_block_that_one_frame_can_hold(places: list[tuple[int, int, int, bool]]) -> None:
    points = [
        point("u32" if wide else "u16", unit_id=unit, function=function, address=address)
        for unit, function, address, wide in places
    ]
    found = blocks(points)
    assert all(1 <= block.count <= 125 for block in found)
    for each in points:
        assert any(
            (block.unit_id, block.function) == (each.unit_id, each.function)
            and block.address <= each.address
            and each.address + each.words <= block.address + block.count
            for block in found
        )


def test_a_contact_is_pressed_when_it_is_open_and_when_its_wire_is_broken() -> None:
    estop = point("contact", quantity="estop_pressed", function=2)
    block = Block(2, 2, 0, 1)
    assert Readings([estop]).quantities({block: [1]}) == {"estop_pressed": False}
    assert Readings([estop]).quantities({block: [0]}) == {"estop_pressed": True}


def test_a_current_of_four_milliamperes_is_nothing_and_of_twenty_is_full() -> None:
    loop = current_loop("pressure_bar", 2, 0, 10.0)
    readings, block = Readings([loop]), Block(2, 4, 0, 1)
    assert readings.quantities({block: [4000]})["pressure_bar"] == 0.0
    assert readings.quantities({block: [20000]})["pressure_bar"] == pytest.approx(10.0)
    assert readings.quantities({block: [12000]})["pressure_bar"] == pytest.approx(5.0)
    assert readings.quantities({block: [3900]})["pressure_bar"] == 0.0


@pytest.mark.parametrize(("current_ua", "why"), [(0, "broken wire"), (3599, "broken wire"), (21500, "short circuit")])
def test_a_current_outside_the_loop_names_the_sensor(current_ua: int, why: str) -> None:
    readings = Readings([current_loop("pressure_bar", 2, 5, 10.0)])
    with pytest.raises(DeviceFault, match=rf"pressure_bar \(unit 2, function 04, address 0x0005\).*{why}"):
        readings.quantities({Block(2, 4, 5, 1): [current_ua]})


@pytest.mark.parametrize("word", [0x7FC0, 0x7F80])
def test_a_float_that_is_no_number_is_not_believed(word: int) -> None:
    readings = Readings([point("f32", low=0.0, high=10.0)])
    with pytest.raises(DeviceFault, match="pressure_bar"):
        readings.quantities({Block(2, 4, 0, 2): [word, 0]})


def test_an_implausible_value_names_its_point() -> None:
    readings = Readings([point(quantity="battery_v", scale=0.1, low=10.0, high=60.0)])
    with pytest.raises(DeviceFault, match=r"battery_v .* from 10 to 60, found 99\.9"):
        readings.quantities({Block(2, 4, 0, 1): [999]})


@given(st.lists(st.integers(0, 100_000), max_size=50), st.integers(0, COUNTS - 1))
def test_a_total_goes_on_over_wraps(steps: list[int], start: int) -> None:
    meter, count = Totaliser(), start
    first = meter.total(start)
    passed = 0
    for step in steps:
        count, passed = (count + step) % COUNTS, passed + step
        assert meter.total(count) == first + passed


@given(st.lists(st.integers(0, COUNTS - 1), max_size=50))
def test_a_total_never_falls(counts: list[int]) -> None:
    meter = Totaliser()
    totals = [meter.total(count) for count in counts]
    assert totals == sorted(totals)


def test_a_module_that_began_anew_counts_from_where_the_total_was() -> None:
    meter = Totaliser()
    assert meter.total(5000) == 5000
    assert meter.total(3) == 5003
    assert meter.total(10) == 5010


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({"quantity": "temperature"}, "unknown quantity"),
        ({"kind": "u64"}, "unknown kind"),
        ({"quantity": "estop_pressed"}, "expected a contact"),
        ({"kind": "contact"}, "expected no contact"),
        ({"function": 2}, "expected function 3 or 4"),
        ({"unit_id": 0}, "no such place"),
        ({"address": 0xFFFF, "kind": "u32"}, "no such place"),
        ({"scale": 0.0}, "scale"),
        ({"offset": math.nan}, "scale"),
    ],
)
def test_a_point_that_cannot_be_is_refused(changes: dict[str, Any], why: str) -> None:
    with pytest.raises(ValueError, match=why):
        point(**{"kind": "u16"} | changes)


def test_settings_want_each_quantity_once_and_its_module() -> None:
    points, modules = reference_points(10_000.0, 5880.0), reference_modules()
    InputsSettings(modules, points)
    with pytest.raises(ValueError, match="found none for estop_pressed"):
        InputsSettings(modules, points[1:])
    with pytest.raises(ValueError, match="found two for pitch_rad"):
        InputsSettings(modules, (*points, points[-1]))
    with pytest.raises(ValueError, match="unit 80 is none of the modules"):
        InputsSettings(modules[:2], points)
    with pytest.raises(ValueError, match="one twice"):
        InputsSettings((*modules, modules[0]), points)


def test_an_unknown_module_lists_the_known() -> None:
    with pytest.raises(ValueError, match="known are analog-8, digital-8, inclinometer"):
        module_named("analog-9", 2)

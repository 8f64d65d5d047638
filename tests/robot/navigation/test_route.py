"""Route files: what they mean, and what is wrong with them."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from pathlib import Path

import pytest

from robot.navigation import Stop, parse_route

ROW = {"name": "A", "side": "left", "length_m": 4.0, "stop_spacing_m": 0.4}


def route(**changes: object) -> Mapping[str, object]:
    row = {**ROW, **changes}
    return {"name": "demo", "row": [{key: value for key, value in row.items() if value is not None}]}


def test_a_row_of_4_m_with_40_cm_spacing_has_ten_stops_in_the_middle_of_their_stretch() -> None:
    (row,) = parse_route(route()).rows
    assert [stop.x_m for stop in row.stops] == pytest.approx([0.2 + 0.4 * k for k in range(10)])
    assert [stop.index for stop in row.stops] == list(range(10))


def test_the_first_stop_may_be_given() -> None:
    (row,) = parse_route(route(first_stop_m=0.0)).rows
    assert (len(row.stops), row.stops[-1]) == (11, Stop(10, 4.0))


def test_stops_may_be_listed() -> None:
    (row,) = parse_route(route(stop_spacing_m=None, stops_m=[0.1, 1, 3.9])).rows
    assert [stop.x_m for stop in row.stops] == [0.1, 1.0, 3.9]


def test_the_shipped_demo_route_is_one_row_at_the_left() -> None:
    path = Path(__file__).parents[3] / "configs" / "routes" / "demo.toml"
    parsed = parse_route(tomllib.loads(path.read_text()))
    assert [(row.side, row.length_m, len(row.stops)) for row in parsed.rows] == [("left", 4.0, 10)]


@pytest.mark.parametrize(
    ("data", "words"),
    [
        ({"name": "x"}, r"at least one \[\[row\]\]"),
        ({"name": "x", "row": "A"}, r"at least one \[\[row\]\]"),
        ({"name": "x", "row": ["A"]}, r"row\[0\]: expected a table"),
        ({"row": [ROW]}, "route.name: expected a name"),
        ({"name": "x", "row": [ROW], "speed": 1}, "unknown key 'speed'; known keys: name, row"),
        ({"name": "x", "row": [ROW, ROW]}, "share a name"),
        (route(side="up"), "expected 'left' or 'right' of the rover, found 'up'"),
        (route(length_m=None), r"row\[0\].length_m: missing"),
        (route(length_m=float("nan")), "expected metres from 0.1 to 1000, found nan"),
        (route(length_m=4000), "found 4000"),
        (route(length_m=True), "found True"),
        (route(stop_spacing_m=0.0), "expected metres from 0.05 to 4"),
        (route(stops_m=[0.1]), "not both; remove stop_spacing_m"),
        (route(stop_spacing_m=None, stops_m=[]), "expected a list of metres"),
        (route(stop_spacing_m=None, stops_m="0.1"), "expected a list of metres"),
        (route(stop_spacing_m=None, stops_m=[0.1, 5.0]), r"stops_m\[1\]: expected metres from 0 to 4, found 5.0"),
        (route(stop_spacing_m=None, stops_m=[0.5, 0.1]), "stops must rise"),
        (route(typo=1), r"row\[0\]: unknown key 'typo'"),
        (route(name=" "), r"row\[0\].name: expected a name"),
    ],
)
def test_a_wrong_route_names_the_key_and_what_was_found(data: Mapping[str, object], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        parse_route(data)

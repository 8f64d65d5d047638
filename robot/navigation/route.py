"""Which rows are treated, from which side, and where the rover stops."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

Side = Literal["left", "right"]
_ROUTE_KEYS = {"name", "row"}
_ROW_KEYS = {"name", "side", "length_m", "stop_spacing_m", "first_stop_m", "stops_m"}
_LONGEST_ROW_M = 1000.0
_NEAREST_STOPS_M = 0.05


@dataclass(frozen=True, slots=True)
class Stop:
    """A place to stop: ``index`` counts from 0 in its row, ``x_m`` along the row."""

    index: int
    x_m: float


@dataclass(frozen=True, slots=True)
class Row:
    """A row of plants at the rover's left or right, with its own row frame."""

    name: str
    side: Side
    length_m: float
    stops: tuple[Stop, ...]


@dataclass(frozen=True, slots=True)
class Route:
    name: str
    rows: tuple[Row, ...]


def parse_route(data: Mapping[str, object]) -> Route:
    """A route from a parsed file: ``name`` and tables ``row`` with name, side, length_m and stops_m or stop_spacing_m.

    With a spacing the first stop is half a spacing into the row, unless ``first_stop_m`` says otherwise.
    ``ValueError`` names the key, what was expected and what was found.
    """
    _only(data, _ROUTE_KEYS, "route")
    rows = data.get("row")
    if not isinstance(rows, Sequence) or isinstance(rows, str) or not rows:
        raise ValueError("route: expected at least one [[row]] table, found none; add one with name, side and length_m")
    parsed = tuple(_row(item, f"row[{index}]") for index, item in enumerate(rows))
    names = [row.name for row in parsed]
    if len(set(names)) != len(names):
        raise ValueError(f"route: two rows share a name in {names}; give each its own")
    return Route(_text(data, "name", "route"), parsed)


def _row(item: object, path: str) -> Row:
    if not isinstance(item, Mapping):
        raise ValueError(f"{path}: expected a table, found {item!r}")  # noqa: TRY004
    _only(item, _ROW_KEYS, path)
    side = item.get("side")
    if side not in ("left", "right"):
        raise ValueError(f"{path}.side: expected 'left' or 'right' of the rover, found {side!r}")
    length_m = _number(item, "length_m", path, 0.1, _LONGEST_ROW_M)
    if "stops_m" in item:
        spare = [key for key in ("stop_spacing_m", "first_stop_m") if key in item]
        if spare:
            raise ValueError(f"{path}: give stops_m or stop_spacing_m, not both; remove {' and '.join(spare)}")
        places = _places(item["stops_m"], f"{path}.stops_m", length_m)
    else:
        spacing_m = _number(item, "stop_spacing_m", path, _NEAREST_STOPS_M, length_m)
        first_m = _number(item, "first_stop_m", path, 0.0, length_m) if "first_stop_m" in item else 0.5 * spacing_m
        count = math.floor((length_m - first_m) / spacing_m + 1e-9) + 1
        places = tuple(first_m + spacing_m * index for index in range(count))
    side_of_row: Side = "left" if side == "left" else "right"
    stops = tuple(Stop(index, round(x_m, 6)) for index, x_m in enumerate(places))
    return Row(_text(item, "name", path), side_of_row, length_m, stops)


def _places(value: object, path: str, length_m: float) -> tuple[float, ...]:
    if not isinstance(value, Sequence) or isinstance(value, str) or not value:
        raise ValueError(f"{path}: expected a list of metres along the row, found {value!r}")
    places = tuple(_finite(item, f"{path}[{index}]", 0.0, length_m) for index, item in enumerate(value))
    if any(b - a < _NEAREST_STOPS_M for a, b in pairwise(places)):
        raise ValueError(f"{path}: stops must rise by {_NEAREST_STOPS_M} m or more, found {list(places)}")
    return places


def _only(data: Mapping[str, object], known: set[str], path: str) -> None:
    unknown = sorted(set(data) - known)
    if unknown:
        raise ValueError(f"{path}: unknown key '{unknown[0]}'; known keys: {', '.join(sorted(known))}")


def _text(data: Mapping[str, object], key: str, path: str) -> str:
    value = data.get(key)
    if not isinstance(value, str) or not value.strip():
        raise ValueError(f"{path}.{key}: expected a name, found {value!r}")
    return value


def _number(data: Mapping[str, object], key: str, path: str, low: float, high: float) -> float:
    if key not in data:
        raise ValueError(f"{path}.{key}: missing; give metres from {low:g} to {high:g}")
    return _finite(data[key], f"{path}.{key}", low, high)


def _finite(value: object, path: str, low: float, high: float) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not low <= value <= high:
        raise ValueError(f"{path}: expected metres from {low:g} to {high:g}, found {value!r}")
    return float(value)

"""A truth file read back, also one whose writer was killed."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from drivers.twin.commands import Command, command_of
from drivers.twin.truth import FORMAT


@dataclass(frozen=True, slots=True)
class TrueFruit:
    id: int
    centre_m: tuple[float, float, float]
    diameter_m: float
    ripeness: str


@dataclass(frozen=True, slots=True)
class TimedCommand:
    t: float
    command: Command


@dataclass(frozen=True, slots=True)
class Event:
    """A physical event: ``what`` and its particulars."""

    t: float
    what: str
    detail: Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class Delivered:
    """One opening of the valve: where its liquid went, and the nozzle's pose (row frame) as it closed."""

    opened_t: float
    closed_t: float
    ml: float
    fruit_ml: Mapping[int, float]
    leaf_ml: float
    stem_ml: float
    soil_ml: float
    air_ml: float
    nozzle_m: tuple[float, float, float]
    axis: tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Snapshot:
    """The machine at rest or as a motion begins; joints are true angles."""

    t: float
    base: tuple[float, float, float]
    counters_m: tuple[float, float]
    joints_rad: tuple[float, ...]
    tank_ml: float
    dispensed_ml: float
    pressure_bar: float


@dataclass(frozen=True, slots=True)
class SeenFruit:
    """How one frame saw one fruit: ``visible`` and ``in_image`` fractions are (left, right)."""

    id: int
    visible: tuple[float, float]
    in_image: tuple[float, float]
    centre_camera_m: tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class View:
    t: float
    sequence: int
    base: tuple[float, float, float]
    fruits: tuple[SeenFruit, ...]


@dataclass(frozen=True, slots=True)
class ProcessTruth:
    """What one process did to the machine; ``world`` holds its parameters as JSON values."""

    world: Mapping[str, Any]
    commands: tuple[TimedCommand, ...]
    events: tuple[Event, ...]
    states: tuple[Snapshot, ...]
    views: tuple[View, ...]
    last_t: float

    @property
    def fruits(self) -> tuple[TrueFruit, ...]:
        return tuple(
            TrueFruit(int(f["id"]), _three(f["centre_m"]), float(f["diameter_m"]), str(f["ripeness"]))
            for f in self.world["fruits"]
        )

    @property
    def delivered(self) -> tuple[Delivered, ...]:
        return tuple(_delivered(event) for event in self.events if event.what == "delivered")


@dataclass(frozen=True, slots=True)
class TruthRecord:
    """All processes that wrote to one truth file, in order; ``torn`` when the last line was cut short."""

    processes: tuple[ProcessTruth, ...]
    torn: bool

    @property
    def fruits(self) -> tuple[TrueFruit, ...]:
        return self.processes[0].fruits

    @property
    def delivered(self) -> tuple[Delivered, ...]:
        return tuple(delivered for process in self.processes for delivered in process.delivered)

    @property
    def fruit_ml(self) -> dict[int, float]:
        """Millilitres on each fruit that got any."""
        sums: dict[int, float] = {}
        for delivered in self.delivered:
            for fruit, ml in delivered.fruit_ml.items():
                sums[fruit] = sums.get(fruit, 0.0) + ml
        return sums


@dataclass(slots=True)
class _Draft:
    world: Mapping[str, Any]
    commands: list[TimedCommand] = field(default_factory=list)
    events: list[Event] = field(default_factory=list)
    states: list[Snapshot] = field(default_factory=list)
    views: list[View] = field(default_factory=list)
    last_t: float = 0.0

    def add(self, line: Mapping[str, Any]) -> None:
        kind, t = line["kind"], float(line["t"])
        self.last_t = max(self.last_t, t)
        if kind == "command":
            self.commands.append(TimedCommand(t, command_of(line["device"], line["verb"], line["args"])))
        elif kind == "event":
            self.events.append(event_of(line))
        elif kind == "state":
            self.states.append(_snapshot(line))
        elif kind == "view":
            seen = tuple(
                SeenFruit(f["id"], tuple(f["visible"]), tuple(f["in_image"]), _three(f["centre"]))
                for f in line["fruits"]
            )
            self.views.append(View(t, line["sequence"], _three(line["base"]), seen))
        else:
            raise ValueError(f"unknown kind of line {kind!r}")

    def done(self) -> ProcessTruth:
        return ProcessTruth(
            self.world, tuple(self.commands), tuple(self.events), tuple(self.states), tuple(self.views), self.last_t
        )


def read_truth(path: Path) -> TruthRecord:
    """Read a truth file, also one whose writer was killed. Raises ``ValueError`` naming the line that is wrong."""
    lines = path.read_bytes().split(b"\n")
    torn = lines.pop() != b""
    drafts: list[_Draft] = []
    for number, text in enumerate(lines, start=1):
        try:
            line = json.loads(text)
            if line["kind"] == "world":
                if line["format"] != FORMAT:
                    raise ValueError(f"expected format {FORMAT}, found {line['format']}; make a new file")
                drafts.append(_Draft(line))
            elif not drafts:
                raise ValueError("expected a world line first")
            else:
                drafts[-1].add(line)
        except (ValueError, KeyError, TypeError) as error:
            raise ValueError(f"truth file {path}, line {number}: {error}") from error
    if not drafts:
        raise ValueError(f"truth file {path}: expected a world line, found an empty file; start a run with it first")
    return TruthRecord(tuple(draft.done() for draft in drafts), torn)


def event_of(line: Mapping[str, Any]) -> Event:
    """The event of a line of kind ``event``."""
    detail = {key: value for key, value in line.items() if key not in ("kind", "t", "what")}
    return Event(float(line["t"]), line["what"], detail)


def _three(values: Sequence[float]) -> tuple[float, float, float]:
    x, y, z = values
    return float(x), float(y), float(z)


def _snapshot(line: Mapping[str, Any]) -> Snapshot:
    left, right = line["counters"]
    return Snapshot(
        t=line["t"],
        base=_three(line["base"]),
        counters_m=(left, right),
        joints_rad=tuple(line["joints"]),
        tank_ml=line["tank_ml"],
        dispensed_ml=line["dispensed_ml"],
        pressure_bar=line["pressure_bar"],
    )


def _delivered(event: Event) -> Delivered:
    detail = event.detail
    return Delivered(
        opened_t=event.t - detail["open_s"],
        closed_t=event.t,
        ml=detail["ml"],
        fruit_ml={int(fruit): ml for fruit, ml in detail["fruit_ml"].items()},
        leaf_ml=detail["leaf_ml"],
        stem_ml=detail["stem_ml"],
        soil_ml=detail["soil_ml"],
        air_ml=detail["air_ml"],
        nozzle_m=_three(detail["nozzle_m"]),
        axis=_three(detail["axis"]),
    )

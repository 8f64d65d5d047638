"""How fruit and detections are sorted: by hour, light, diameter, distance, visibility, ripeness."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from robot.vision.values import Fruit
from tests.bench.vision.labelled import SceneFacts, TrueFruit
from tests.bench.vision.scoring import Judged, Statistics, share, statistics_of


@dataclass(frozen=True, slots=True)
class Grouping:
    """``of_truth`` and ``of_found`` name the group of a true fruit and of a detection, which is sorted by what it says
    of itself (None: detections are not sorted so). ``order`` lists the groups, () takes them in order of their names.
    """

    key: str
    title: str
    axis: str
    of_truth: Callable[[SceneFacts, TrueFruit], str]
    of_found: Callable[[SceneFacts, Fruit], str] | None
    order: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Group:
    """One group's figures; ``precision`` of the ``detections`` that say they belong to it."""

    name: str
    statistics: Statistics
    detections: int | None
    precision: float | None


LIGHTS = ("< 1 %", "1-6 %", "6-12 %", "12-20 %", "> 20 %")
SIZES = ("< 5 cm", "5-7 cm", "7-9 cm", "9-12 cm", "12-14 cm", "> 14 cm")
VISIBILITIES = ("<0.8", "0.8-0.95", "0.95-1")
KINDS = ("red", "turning", "green")


def hour_label(scene: SceneFacts) -> str:
    return f"{scene.hour:02d}{'+lamp' if scene.lamp else ''}"


def light_label(scene: SceneFacts) -> str:
    return _bin(scene.light_percent, (1.0, 6.0, 12.0, 20.0), LIGHTS)


def size_label(diameter_m: float) -> str:
    return _bin(100.0 * diameter_m, (5.0, 7.0, 9.0, 12.0, 14.0), SIZES)


def coarse_size_label(diameter_m: float) -> str:
    """The paper's range and what lies outside it."""
    if diameter_m < 0.07:
        return "<6 cm" if diameter_m < 0.06 else "6-7 cm"
    return "7-12 cm" if diameter_m <= 0.12 else ">12 cm"


def distance_label(z_m: float) -> str:
    tenth = int(10.0 * z_m + 1e-9) / 10
    return f"{tenth:.1f}-{tenth + 0.1:.1f} m"


def visibility_label(fraction: float) -> str:
    return _bin(fraction, (0.8, 0.95), VISIBILITIES)


GROUPINGS = (
    Grouping("hour", "by hour", "hour", lambda s, _: hour_label(s), lambda s, _: hour_label(s)),
    Grouping(
        "light",
        "by light (mean luminance of the left image, of full scale)",
        "mean luminance of the picture, of full scale",
        lambda s, _: light_label(s),
        lambda s, _: light_label(s),
        LIGHTS,
    ),
    Grouping(
        "size",
        "by diameter",
        "diameter of the fruit",
        lambda _, t: size_label(t.diameter_m),
        lambda _, f: size_label(f.diameter_m),
        SIZES,
    ),
    Grouping(
        "distance",
        "by distance (along the optical axis)",
        "distance along the optical axis",
        lambda _, t: distance_label(float(t.centre_m[2])),
        lambda _, f: distance_label(float(f.centre_m[2])),
    ),
    Grouping(
        "visible",
        "by visibility (smaller of both views)",
        "share of the fruit that shows",
        lambda _, t: visibility_label(t.visible_fraction),
        None,
        VISIBILITIES,
    ),
    Grouping(
        "ripeness",
        "by ripeness",
        "ripeness",
        lambda _, t: t.ripeness,
        lambda _, f: str(f.ripeness.value),
        KINDS,
    ),
    Grouping(
        "touching",
        "by neighbours",
        "touching another fruit or not",
        lambda _, t: "touching" if t.touching else "single",
        None,
    ),
    Grouping("rig", "by rig", "rig", lambda s, _: s.rig, lambda s, _: s.rig),
    Grouping("weather", "by weather", "weather", lambda s, _: s.weather, lambda s, _: s.weather),
    Grouping(
        "diameter",
        "by diameter, the paper's range and outside it",
        "diameter of the fruit",
        lambda _, t: coarse_size_label(t.diameter_m),
        lambda _, f: coarse_size_label(f.diameter_m),
        ("<6 cm", "6-7 cm", "7-12 cm", ">12 cm"),
    ),
)


def grouped(judged: Judged, grouping: Grouping) -> tuple[Group, ...]:
    """The figures of every group that has an eligible fruit."""
    names = {grouping.of_truth(sighting.scene, sighting.truth) for sighting in judged.sightings}
    order: Sequence[str] = grouping.order or sorted(names)
    return tuple(_group(judged, grouping, name) for name in order if name in names)


def _group(judged: Judged, grouping: Grouping, name: str) -> Group:
    mine = [s for s in judged.sightings if grouping.of_truth(s.scene, s.truth) == name]
    if grouping.of_found is None:
        return Group(name, statistics_of(mine), None, None)
    of_found = grouping.of_found
    said = [d for d in judged.detections if of_found(d.scene, d.fruit) == name]
    return Group(name, statistics_of(mine), len(said), share(sum(d.real for d in said), len(said)))


def _bin(value: float, edges: Sequence[float], names: Sequence[str]) -> str:
    return names[sum(value >= edge for edge in edges)]

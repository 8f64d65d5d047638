"""Labelled scenes of the twin: rows by the hour, and single fruit with nothing before them."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from drivers.twin.light import Light, light_at
from drivers.twin.optics import StereoOptics
from drivers.twin.plants import grow
from drivers.twin.renderer import StereoRenderer
from drivers.twin.scene import Scene
from drivers.twin.sightings import FruitView
from drivers.twin.solids import Greenhouse, Rgb, TwinFruit, TwinRipeness
from robot.geometry import rotation_from_rpy
from robot.vision.stereo_rig import StereoRig
from tests.bench.vision.labelled import SceneFacts, StereoScene, StereoSet, TrueFruit, light_percent

Array = npt.NDArray[np.float64]

ROW_SEEDS = (31, 32, 33, 34)
ROW_STOPS_M = (0.4, 1.2, 2.0)
HOURS = (8, 10, 12, 14, 16, 18, 19, 20)
LAMP_HOURS = (19, 20)
SINGLE_DISTANCES_M = (0.3, 0.5, 0.8)
SINGLES = 40
_KINDS: tuple[TwinRipeness, ...] = ("red", "turning", "green")
_SINGLE_HOURS = (10, 12, 14)
_BACK_M = 0.02  # least air between a single fruit and whatever hangs behind it
_CAMERA_M = (1.25, 0.05, 0.88)  # in the row frame


def twin_rows(rig_name: str = "640") -> StereoSet:
    """Rows seen from their stops, morning to night, at a fixed exposure; at 19 and 20 h with the lamp too."""
    lights = [(hour, False) for hour in HOURS] + [(hour, True) for hour in LAMP_HOURS]
    names = tuple(
        f"row{seed}_{rig_name}_{hour:02d}h{'_lamp' if lamp else ''}_stop{stop}"
        for seed in ROW_SEEDS
        for hour, lamp in lights
        for stop in range(len(ROW_STOPS_M))
    )
    size = "x".join(str(side) for side in rig_of(rig_name).image_size)
    return StereoSet(f"twin_rows_{rig_name}", f"twin, rows, {size}", names, _row_scene)


def twin_singles(distance_m: float, count: int = SINGLES) -> StereoSet:
    """Single fruit, 5 to 12 cm, wholly in both 1280x720 images, ``distance_m`` before the left camera."""
    names = tuple(f"single_{1e3 * distance_m:.0f}mm_{number:02d}" for number in range(count))
    title = f"twin, one fruit at {distance_m:g} m, 1280x720"
    return StereoSet(f"twin_single_{1e3 * distance_m:.0f}mm", title, names, _single_scene)


def rig_of(name: str) -> StereoRig:
    """``640`` and ``1280``: parallel and without distortion, 70 degrees wide, 60 mm; ``..crooked``: neither."""
    size = (1280, 720) if name.startswith("1280") else (640, 480)
    focal, middle = (914.0, (639.5, 359.5)) if size[0] == 1280 else (457.0, (319.5, 239.5))
    K = np.array([[focal, 0.0, middle[0]], [0.0, focal, middle[1]], [0.0, 0.0, 1.0]])
    rig = StereoRig(size, K, K, np.zeros(5), np.zeros(5), np.eye(3), np.array([-0.06, 0.0, 0.0]))
    if not name.endswith("crooked"):
        return rig
    K_right = K.copy()
    K_right[0] *= 0.996
    K_right[1] *= 0.994
    return replace(
        rig,
        K_right=K_right,
        dist_left=np.array([-0.11, 0.026, 0.0005, 0.0, 0.0]),
        dist_right=np.array([-0.104, 0.022, 0.0, 0.0, 0.0]),
        R=rotation_from_rpy(0.004, -0.009, 0.012),
    )


def _row_scene(name: str) -> StereoScene:
    seed_part, rig_name, hour_part, *lamp, stop_part = name.split("_")
    seed, hour, stop = int(seed_part[3:]), int(hour_part[:2]), int(stop_part[4:])
    scene = Scene(seed=seed, hour=float(hour), row_length_m=2.5)
    renderer, greenhouse = _row(seed, rig_name)
    light = light_at(scene.hour, lamp_on=bool(lamp))
    facts = SceneFacts(name, hour, bool(lamp), scene.weather, rig_name, 0.0)
    pose = _pose(ROW_STOPS_M[stop], 0.05, 0.88)
    return _photographed(facts, renderer, greenhouse, pose, light, frame=100 * hour + 10 * bool(lamp) + stop)


@lru_cache(maxsize=2)
def _row(seed: int, rig_name: str) -> tuple[StereoRenderer, Greenhouse]:
    greenhouse = grow(Scene(seed=seed, row_length_m=2.5))
    return StereoRenderer(greenhouse, _optics(rig_of(rig_name)), seed), greenhouse


@dataclass(frozen=True, slots=True, eq=False)
class _Single:
    """A draft of one fruit: what it is, where the camera has it, and in which light."""

    centre_m: Array
    diameter_m: float
    oblateness: float
    axis: Array
    ripeness: TwinRipeness
    stage: float
    hour: int
    overcast: bool


def _single_scene(name: str) -> StereoScene:
    _, distance_part, number_part = name.split("_")
    distance_m, number = int(distance_part[:-2]) / 1e3, int(number_part)
    rig_name = "1280crooked" if number % 2 else "1280"
    rig = rig_of(rig_name)
    dice = np.random.default_rng([17, round(1e3 * distance_m), number])
    draft = _draft(dice, distance_m, number)
    while not _well_inside(draft, rig):
        draft = _draft(dice, distance_m, number)
    greenhouse = _before_a_row(draft, seed=200 + number)
    light = light_at(float(draft.hour), "overcast" if draft.overcast else "clear")
    facts = SceneFacts(name, draft.hour, False, "overcast" if draft.overcast else "clear", rig_name, 0.0)
    renderer = StereoRenderer(greenhouse, _optics(rig), 200 + number)
    return _photographed(facts, renderer, greenhouse, _pose(*_CAMERA_M), light, frame=number)


def _draft(dice: np.random.Generator, distance_m: float, number: int) -> _Single:
    """Place by pixels of a 1280x720 image, so that far and near fruit lie off the axis alike."""
    u, v = dice.uniform(-560.0, 620.0), dice.uniform(-320.0, 320.0)
    tilt, bearing = abs(dice.normal(0.0, 0.4)), dice.uniform(0.0, math.tau)
    return _Single(
        centre_m=distance_m * np.array([u / 914.0, v / 914.0, 1.0]),
        diameter_m=float(dice.uniform(0.05, 0.12)),
        oblateness=float(dice.uniform(0.80, 0.98)),
        axis=np.array([math.sin(tilt) * math.cos(bearing), math.sin(tilt) * math.sin(bearing), math.cos(tilt)]),
        ripeness=_KINDS[number % 3],
        stage=float(dice.uniform(0.0, 1.0)),
        hour=_SINGLE_HOURS[int(dice.integers(3))],
        overcast=bool(dice.random() < 0.3),
    )


def _well_inside(draft: _Single, rig: StereoRig) -> bool:
    """Whether a ball round the fruit projects into both images with 8 px to spare."""
    radius_m = 0.5 * draft.diameter_m * draft.oblateness ** (-1.0 / 3.0)
    turn = np.linspace(0.0, math.tau, 24, endpoint=False)
    sight = draft.centre_m / np.linalg.norm(draft.centre_m)
    across = np.cross(sight, [0.0, 1.0, 0.0])
    across /= np.linalg.norm(across)
    up = np.cross(sight, across)
    rim = draft.centre_m + 1.15 * radius_m * (np.cos(turn)[:, None] * across + np.sin(turn)[:, None] * up)
    width, height = rig.image_size
    pixels = np.vstack([rig.project_left(rim), rig.project_right(rim)])
    return bool(np.all((pixels >= 8.0) & (pixels <= np.array([width, height]) - 9.0)))


def _before_a_row(draft: _Single, seed: int) -> Greenhouse:
    """A row without fruit, cut back to what hangs behind the one fruit."""
    plants = grow(Scene(seed=seed, row_length_m=2.5, fruits_per_plant=0.0))
    pose = _pose(*_CAMERA_M)
    fruit = TwinFruit(
        id=1,
        centre_m=pose[:3, :3] @ draft.centre_m + pose[:3, 3],
        diameter_m=draft.diameter_m,
        oblateness=draft.oblateness,
        axis=draft.axis,
        ripeness=draft.ripeness,
        colour=_skin(draft.ripeness, draft.stage, shoulder=False),
        shoulder=_skin(draft.ripeness, draft.stage, shoulder=True),
    )
    behind_m = float(fruit.centre_m[1]) + fruit.semi_equatorial_m + _BACK_M
    nearest = (plants.leaves.centre_m[:, 1] - plants.leaves.reach_m) > behind_m
    leaves = replace(
        plants.leaves,
        **{key: getattr(plants.leaves, key)[nearest] for key in ("corner_m", "u_m", "v_m", "texture", "tint")},
    )
    stems = tuple(stem for stem in plants.stems if min(stem.p0_m[1], stem.p1_m[1]) - stem.radius_m > behind_m)
    supports = tuple(stem for stem in plants.supports if stem in stems)
    return replace(plants, fruits=(fruit,), leaves=leaves, stems=stems, supports=supports)


def _skin(ripeness: TwinRipeness, stage: float, *, shoulder: bool) -> Rgb:
    """Linear reflectance, ``stage`` 0..1 within the kind."""
    green = np.array([0.135, 0.235, 0.055]) * (0.75 + 0.5 * stage)
    if ripeness == "green":
        return _rgb(green * ([0.6, 0.75, 0.7] if shoulder else 1.0))
    if ripeness == "turning":
        flank = (0.25 + 0.5 * stage) * np.array([0.52, 0.17, 0.035]) + (0.75 - 0.5 * stage) * np.array(
            [0.36, 0.27, 0.06]
        )
        return _rgb(0.55 * green + 0.45 * flank if shoulder else flank)
    red = np.array([0.46, 0.032, 0.02]) * (0.8 + 0.35 * stage)
    return _rgb(red * ([0.95, 1.6, 1.1] if shoulder else 1.0))


def _rgb(colour: Array) -> Rgb:
    return float(colour[0]), float(colour[1]), float(colour[2])


def _photographed(
    facts: SceneFacts, renderer: StereoRenderer, greenhouse: Greenhouse, pose: Array, light: Light, *, frame: int
) -> StereoScene:
    left, right = renderer.render(pose, light, frame=frame)
    views = renderer.truth(pose)
    by_id = {fruit.id: fruit for fruit in greenhouse.fruits}
    fruits = tuple(_true_fruit(view, by_id) for view in views if view.left.area_px2 > 0.0)
    facts = replace(facts, light_percent=light_percent(left))
    return StereoScene(facts, left, right, rig_of(facts.rig), fruits)


def _true_fruit(view: FruitView, by_id: dict[int, TwinFruit]) -> TrueFruit:
    fruit = by_id[view.id]
    touching = any(
        np.linalg.norm(other.centre_m - fruit.centre_m) < other.semi_equatorial_m + fruit.semi_equatorial_m
        for other in by_id.values()
        if other is not fruit
    )
    u, v = view.left.centre_px
    radius_px = math.sqrt(view.left.area_px2 / math.pi)
    return TrueFruit(
        id=fruit.id,
        centre_m=np.asarray(view.centre_m, dtype=np.float64),
        diameter_m=fruit.diameter_m,
        ripeness=fruit.ripeness,
        visible_fraction=view.visible_fraction,
        left_px=(float(u), float(v), radius_px),
        touching=bool(touching),
    )


def _optics(rig: StereoRig) -> StereoOptics:
    return StereoOptics(rig.image_size, rig.K_left, rig.K_right, rig.dist_left, rig.dist_right, rig.R, rig.t_m)


def _pose(x_m: float, y_m: float, z_m: float) -> Array:
    """Row from camera: looking along +y."""
    return np.array([[1.0, 0.0, 0.0, x_m], [0.0, 0.0, 1.0, y_m], [0.0, -1.0, 0.0, z_m], [0.0, 0.0, 0.0, 1.0]])

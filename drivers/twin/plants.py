"""Grow a row of tomato plants from a scene."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from drivers.twin.contact import overlaps, touching_distance
from drivers.twin.leaf_pictures import PAIRS, TERMINALS
from drivers.twin.scene import Scene
from drivers.twin.solids import Capsule, Greenhouse, Leaves, Rgb, TwinFruit, TwinRipeness

__all__ = ["Greenhouse", "TwinFruit", "grow"]

Array = npt.NDArray[np.float64]

FRUIT_LOW_M, FRUIT_HIGH_M = 0.55, 1.15
FRUIT_NEAR_M, FRUIT_FAR_M = 0.28, -0.10  # before and behind the stem, towards the lane
TOP_M = 1.9
STEM_COLOUR: Rgb = (0.10, 0.17, 0.06)
CANE_COLOUR: Rgb = (0.34, 0.29, 0.20)
TRUSS_COLOUR: Rgb = (0.09, 0.18, 0.05)
VEILED_SHARE = 0.35
GAP_M = 0.004  # least air between two fruits that do not touch
_PLACING_TRIES = 60


def grow(scene: Scene) -> Greenhouse:
    """The greenhouse of a scene, in the row frame; the same scene gives the same plants."""
    rng = np.random.default_rng(scene.seed)
    lane = np.array([0.0, -scene.side_sign, 0.0])  # from the row towards the rover
    count = max(1, round(scene.row_length_m / scene.plant_spacing_m))
    feet = [
        np.array(
            [
                (k + 0.5) * scene.row_length_m / count + rng.normal(0.0, 0.02),
                scene.side_sign * (scene.stem_distance_m + rng.uniform(-0.02, 0.02)),
                0.0,
            ]
        )
        for k in range(count)
    ]
    vines = [_vine(foot, rng) for foot in feet]
    beside, above = np.array([0.02, 0.0, 0.0]), np.array([0.02, 0.0, 2.1])
    supports = tuple(Capsule(foot + beside, foot + above, 0.004, CANE_COLOUR) for foot in feet)
    fruits: list[TwinFruit] = []
    trusses: list[Capsule] = []
    for foot in feet:
        for fruit in _fruits_of_plant(scene, foot, lane, fruits, rng):
            fruits.append(fruit)
            trusses.append(_truss(fruit, foot))
    leaves = [_leaves_of_plant(scene, foot, lane, rng) for foot in feet]
    leaves.append(_veils(scene, fruits, lane, rng))
    stems = tuple(capsule for vine in vines for capsule in vine) + supports + tuple(trusses)
    return Greenhouse(
        fruits=tuple(fruits),
        leaves=_without_pierced(_joined(leaves), fruits),
        stems=stems,
        supports=supports,
        wall_y_m=scene.side_sign * scene.wall_distance_m,
        seed=scene.seed,
    )


def _vine(foot: Array, rng: np.random.Generator) -> list[Capsule]:
    knots = [foot]
    for height in (0.45, 0.9, 1.35, TOP_M):
        knots.append(np.array([foot[0] + rng.normal(0.0, 0.012), foot[1] + rng.normal(0.0, 0.012), height]))
    radii = (0.0075, 0.0065, 0.0055, 0.0045)
    return [Capsule(low, high, radius, STEM_COLOUR) for low, high, radius in zip(knots, knots[1:], radii, strict=False)]


def _fruits_of_plant(
    scene: Scene, foot: Array, lane: Array, grown: list[TwinFruit], rng: np.random.Generator
) -> list[TwinFruit]:
    wanted = int(rng.poisson(scene.fruits_per_plant * 0.5) + rng.binomial(round(scene.fruits_per_plant), 0.5))
    new: list[TwinFruit] = []
    while len(new) < wanted:
        others = grown + new
        clustered = bool(new) and rng.random() < scene.cluster_share
        fruit = None
        for _ in range(_PLACING_TRIES):
            draft = _draft(scene, len(others) + 1, rng)
            draft = _beside(draft, new[-1], rng) if clustered else _moved(draft, _place(foot, lane, rng))
            if _fits(draft, others, foot, lane, scene, new[-1] if clustered else None):
                fruit = draft
                break
        if fruit is None:
            break  # the plant is full
        new.append(fruit)
    return new


def _draft(scene: Scene, number: int, rng: np.random.Generator) -> TwinFruit:
    ripeness: TwinRipeness = "green"
    throw = rng.random()
    if throw < scene.red_share:
        ripeness = "red"
    elif throw < scene.red_share + scene.turning_share:
        ripeness = "turning"
    size = scene.diameter_mode_m * math.exp(rng.normal(0.05, 0.22))
    tilt, bearing = abs(rng.normal(0.0, 0.3)), rng.uniform(0.0, math.tau)
    axis = np.array([math.sin(tilt) * math.cos(bearing), math.sin(tilt) * math.sin(bearing), math.cos(tilt)])
    flank, shoulder = _skin(ripeness, rng)
    return TwinFruit(
        id=number,
        centre_m=np.zeros(3),
        diameter_m=float(np.clip(size, scene.diameter_min_m, scene.diameter_max_m)),
        oblateness=float(rng.uniform(0.80, 0.97)),
        axis=axis,
        ripeness=ripeness,
        colour=flank,
        shoulder=shoulder,
    )


def _skin(ripeness: TwinRipeness, rng: np.random.Generator) -> tuple[Rgb, Rgb]:
    """Linear RGB reflectance of flank and shoulder."""
    green = np.array([0.135, 0.235, 0.055]) * rng.uniform(0.65, 1.35) * np.array([rng.uniform(0.85, 1.2), 1.0, 1.0])
    if ripeness == "green":
        return _rgb(green), _rgb(green * [0.6, 0.75, 0.7])
    if ripeness == "turning":
        stage = rng.uniform(0.25, 0.75)
        orange = np.array([0.52, 0.17, 0.035])
        flank = stage * orange + (1.0 - stage) * np.array([0.36, 0.27, 0.06])
        return _rgb(flank), _rgb(0.55 * green + 0.45 * flank)
    red = np.array([0.46, 0.032, 0.02]) * rng.uniform(0.75, 1.2)
    return _rgb(red), _rgb(red * [0.95, 1.6, 1.1])


def _rgb(colour: Array) -> Rgb:
    return float(colour[0]), float(colour[1]), float(colour[2])


def _place(foot: Array, lane: Array, rng: np.random.Generator) -> Array:
    forward = rng.triangular(FRUIT_FAR_M, 0.06, FRUIT_NEAR_M)
    place = foot + lane * forward
    place[0] += rng.uniform(-0.19, 0.19)
    place[2] = rng.uniform(FRUIT_LOW_M, FRUIT_HIGH_M)
    return np.asarray(place)


def _moved(fruit: TwinFruit, centre_m: Array) -> TwinFruit:
    return TwinFruit(
        fruit.id, centre_m, fruit.diameter_m, fruit.oblateness, fruit.axis, fruit.ripeness, fruit.colour, fruit.shoulder
    )


def _beside(fruit: TwinFruit, neighbour: TwinFruit, rng: np.random.Generator) -> TwinFruit:
    direction = rng.normal(size=3) * [1.0, 0.5, 0.8]
    direction /= np.linalg.norm(direction)
    reach = touching_distance(fruit.shape(), neighbour.shape(), direction)
    return _moved(fruit, neighbour.centre_m + direction * reach * (1.0 + 1e-6))


def _fits(
    fruit: TwinFruit, others: list[TwinFruit], foot: Array, lane: Array, scene: Scene, touched: TwinFruit | None
) -> bool:
    x, y, z = fruit.centre_m
    forward = float((fruit.centre_m - foot) @ lane)
    if not (FRUIT_LOW_M <= z <= FRUIT_HIGH_M and FRUIT_FAR_M <= forward <= FRUIT_NEAR_M):
        return False
    if not 0.0 <= x <= scene.row_length_m:
        return False
    if math.hypot(x - foot[0] - 0.01, y - foot[1]) < fruit.semi_equatorial_m + 0.04:  # vine and cane pass beside it
        return False
    shape = fruit.shape()
    for other in others:
        reach = fruit.semi_equatorial_m + other.semi_equatorial_m + GAP_M
        if other is touched or np.linalg.norm(fruit.centre_m - other.centre_m) > reach:
            continue
        if overlaps(shape, other.shape(), fruit.centre_m - other.centre_m, GAP_M):
            return False
    return True


def _truss(fruit: TwinFruit, foot: Array) -> Capsule:
    top = fruit.centre_m + fruit.axis * fruit.semi_polar_m
    joint = np.array([foot[0], foot[1], min(top[2] + 0.10, TOP_M)])
    along = joint - top
    return Capsule(top, top + along * min(1.0, 0.16 / float(np.linalg.norm(along))), 0.0026, TRUSS_COLOUR)


def _leaves_of_plant(scene: Scene, foot: Array, lane: Array, rng: np.random.Generator) -> Leaves:
    """Compound leaves: each a drooping midrib with pairs of leaflets and one at its end."""
    corner: list[Array] = []
    u: list[Array] = []
    v: list[Array] = []
    texture: list[int] = []
    tint: list[Array] = []
    bearing = rng.uniform(0.0, math.tau)
    count = round(11 * scene.leaf_density)
    for k in range(count):
        height = 0.42 + (k + rng.uniform(0.0, 1.0)) * (TOP_M - 0.5) / max(count, 1)
        bearing += 2.4 + rng.normal(0.0, 0.25)  # golden angle
        out = np.array([math.cos(bearing), math.sin(bearing), 0.0])
        if out @ lane < -0.2 and rng.random() < 0.7:
            out -= 2.0 * (out @ lane) * lane  # plants lean their leaves to the light of the lane
        pitch = rng.uniform(-0.35, 0.45)
        here = np.array([foot[0], foot[1], height]) + 0.03 * out
        shade = rng.uniform(0.75, 1.25) * np.array([rng.uniform(0.85, 1.2), 1.0, rng.uniform(0.8, 1.15)])
        scale = rng.uniform(0.8, 1.2)
        for last in (False, True):
            along = math.cos(pitch) * out + np.array([0.0, 0.0, math.sin(pitch)])
            across = np.cross(along, [0.0, 0.0, 1.0])
            across /= np.linalg.norm(across)
            roll = rng.normal(0.0, 0.5)
            across = math.cos(roll) * across + math.sin(roll) * np.cross(along, across)
            length = scale * (0.12 if last else 0.16)
            width = scale * (0.10 if last else 0.17)
            corner.append(here - 0.5 * width * across)
            u.append(width * across)
            v.append(length * along)
            texture.append(int(rng.choice(TERMINALS if last else PAIRS)))
            tint.append(shade * rng.uniform(0.9, 1.1))
            here = here + length * along
            pitch -= rng.uniform(0.35, 0.8)
    return _leaves(corner, u, v, texture, tint)


def _veils(scene: Scene, fruits: list[TwinFruit], lane: Array, rng: np.random.Generator) -> Leaves:
    """Leaves that hang before fruit, towards the lane."""
    corner: list[Array] = []
    u: list[Array] = []
    v: list[Array] = []
    texture: list[int] = []
    tint: list[Array] = []
    for fruit in fruits:
        if rng.random() >= VEILED_SHARE * scene.leaf_density:
            continue
        size = rng.uniform(0.085, 0.125)
        turn, lean = rng.normal(0.0, 0.5), rng.uniform(-0.2, 0.5)
        side = np.array([math.cos(turn), -lane[1] * math.sin(turn), 0.0])
        down = np.array([0.0, 0.0, -math.cos(lean)]) + lane * math.sin(lean)
        swing = rng.normal(0.0, 0.45)
        across, along = math.cos(swing) * side + math.sin(swing) * down, math.cos(swing) * down - math.sin(swing) * side
        middle = fruit.centre_m + lane * (fruit.semi_equatorial_m + rng.uniform(0.015, 0.06))
        middle = middle + rng.normal(0.0, 0.45 * fruit.semi_equatorial_m, 3) * [1.0, 0.0, 1.0]
        u.append(0.8 * size * across)
        v.append(size * along)
        corner.append(middle - 0.5 * (u[-1] + v[-1]))
        texture.append(int(rng.choice(TERMINALS)))
        tint.append(rng.uniform(0.75, 1.25) * np.array([rng.uniform(0.85, 1.2), 1.0, rng.uniform(0.8, 1.15)]))
    return _leaves(corner, u, v, texture, tint)


def _leaves(corner: list[Array], u: list[Array], v: list[Array], texture: list[int], tint: list[Array]) -> Leaves:
    return Leaves(
        np.array(corner).reshape(-1, 3),
        np.array(u).reshape(-1, 3),
        np.array(v).reshape(-1, 3),
        np.array(texture, dtype=np.int64),
        np.array(tint).reshape(-1, 3),
    )


def _joined(parts: list[Leaves]) -> Leaves:
    return Leaves(
        np.concatenate([part.corner_m for part in parts]),
        np.concatenate([part.u_m for part in parts]),
        np.concatenate([part.v_m for part in parts]),
        np.concatenate([part.texture for part in parts]),
        np.concatenate([part.tint for part in parts]),
    )


def _without_pierced(leaves: Leaves, fruits: list[TwinFruit]) -> Leaves:
    """Leave out the leaves whose middle lies inside a fruit: a fruit pushes them aside."""
    keep = np.ones(len(leaves), dtype=bool)
    grid = np.array([(a, b) for a in (0.2, 0.5, 0.8) for b in (0.1, 0.35, 0.65, 0.9)])
    points = leaves.corner_m[:, None] + grid[:, :1] * leaves.u_m[:, None] + grid[:, 1:] * leaves.v_m[:, None]
    for fruit in fruits:
        away = points - fruit.centre_m
        keep &= ~np.any(np.einsum("npi,ij,npj->np", away, fruit.shape(), away) < 1.0, axis=1)
    return Leaves(
        leaves.corner_m[keep], leaves.u_m[keep], leaves.v_m[keep], leaves.texture[keep], leaves.tint[keep]
    )

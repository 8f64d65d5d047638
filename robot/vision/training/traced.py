"""Unrolled pictures with the answers the tracing network should give, drawn from labelled scenes."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from robot.vision.fruit.polar import ANGLES, STEPS
from robot.vision.fruit.rectify import ParallelPair, parallel_pair
from robot.vision.stereo_rig import StereoRig
from robot.vision.training.labelled import Image, Mask, Scene, Sight
from robot.vision.training.true_outlines import Outline

Array = npt.NDArray[np.float64]

RIGHT_CENTRE, RIGHT_SIZE = 0.3, 0.4
"""Nearer than this share of the diameter, and of about this size (log), the guess is of the fruit."""


@dataclass(frozen=True, slots=True, eq=False)
class Known:
    """A fruit in the pair's frame with its outlines; ``edge_shows`` (2, ANGLES): the outline is seen there, nan where
    nobody knows. ``visible`` is the smaller of both views' shares."""

    centre_m: Array
    radius_m: float
    outlines: tuple[Outline, Outline]
    edge_shows: Array
    visible: float


@dataclass(frozen=True, slots=True, eq=False)
class Place:
    """A scene ready to be drawn from."""

    images: tuple[Image, Image]
    rig: StereoRig
    pair: ParallelPair
    fruits: tuple[Known, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Trace:
    """``planes`` (8, ANGLES, STEPS); ``offset`` (2, ANGLES) of the outline in steps from the middle, nan beyond the
    band; ``shows`` (2, ANGLES) 0, 1 or nan; ``fruit`` 0 or 1,
    nan where neither is right; ``visible`` share of the fruit, nan where there is none."""

    planes: npt.NDArray[np.float32]
    offset: Array
    shows: Array
    fruit: float
    visible: float


def places_of(found: Iterable[Scene]) -> list[Place]:
    """Scenes with the outlines of their fruit."""
    out = []
    for scene in found:
        pair = parallel_pair(scene.rig)
        fruits = tuple(
            Known(
                pair.rect_from_left @ tomato.centre_m,
                tomato.diameter_m / 2,
                (tomato.left.outline, tomato.right.outline),
                np.stack(
                    [
                        _edge_shows(sight, mask, tomato.number)
                        for sight, mask in ((tomato.left, scene.mask_left), (tomato.right, scene.mask_right))
                    ]
                ),
                tomato.visible_fraction,
            )
            for tomato in scene.tomatoes
        )
        out.append(Place((scene.left, scene.right), scene.rig, pair, fruits))
    return out


def _edge_shows(sight: Sight, mask: Mask | None, number: int) -> Array:
    """(ANGLES,) whether the skin reaches to the outline and ends there."""
    turn = np.arange(ANGLES) * (2 * np.pi / ANGLES)
    if mask is None:
        return np.full(ANGLES, 1.0 if sight.visible_fraction > 0.985 else np.nan)
    height, width = mask.shape
    radii = sight.outline.radii(turn)
    slack = np.maximum(1.5, 0.05 * radii)
    inner, outer = radii - slack, radii + slack
    skin = (mask == number) | (mask == 100 + number)

    def on(reach: Array) -> npt.NDArray[np.bool_]:
        u = np.rint(sight.outline.u_px + reach * np.cos(turn)).astype(int)
        v = np.rint(sight.outline.v_px + reach * np.sin(turn)).astype(int)
        inside = (u >= 0) & (v >= 0) & (u < width) & (v < height)
        out = np.zeros(ANGLES, dtype=bool)
        out[inside] = skin[v[inside], u[inside]]
        return out

    return (on(inner) & ~on(outer)).astype(np.float64)


def trace_answers(place: Place, planes: npt.NDArray[np.float32], at: Array, centre_m: Array, radius_m: float) -> Trace:
    """The truth about ``planes`` unrolled at the pixels ``at`` (2, ANGLES, STEPS, 2) round a guess of a sphere."""
    unknown = np.full((2, ANGLES), np.nan)
    if not place.fruits:
        return Trace(planes, unknown, unknown, 0.0, np.nan)
    apart = np.array([np.linalg.norm(fruit.centre_m - centre_m) / (2 * fruit.radius_m) for fruit in place.fruits])
    known = place.fruits[int(apart.argmin())]
    error, size = float(apart.min()), abs(float(np.log(radius_m / known.radius_m)))
    if error > 0.5:
        return Trace(planes, unknown, unknown, 0.0, np.nan)
    offset = np.stack([_crossing(at[eye], known.outlines[eye]) for eye in range(2)])
    shows = np.stack([_shown(at[eye], known.outlines[eye], known.edge_shows[eye]) for eye in range(2)])
    right = 1.0 if error < RIGHT_CENTRE and size < RIGHT_SIZE else np.nan
    if known.visible < 0.25:
        right = np.nan
    return Trace(planes, offset, shows, right, known.visible)


def _crossing(places: Array, outline: Outline) -> Array:
    """(ANGLES,) step from the middle at which each ray (ANGLES, STEPS, 2) leaves the outline, nan if it does not."""
    across = places - [outline.u_px, outline.v_px]
    beyond = np.hypot(across[..., 0], across[..., 1]) - outline.radii(np.arctan2(across[..., 1], across[..., 0]))
    leaves = (beyond[:, :-1] <= 0) & (beyond[:, 1:] > 0)
    at = leaves.argmax(axis=1)
    rows = np.arange(len(places))
    before, after = beyond[rows, at], beyond[rows, at + 1]
    out = at + before / np.where(before - after == 0, 1.0, before - after) - (STEPS - 1) / 2
    return np.where(leaves.any(axis=1), out, np.nan)


def _shown(places: Array, outline: Outline, shows: Array) -> Array:
    """What is known of the outline at the angle of each ray."""
    across = places[:, STEPS // 2] - [outline.u_px, outline.v_px]
    turn = np.arctan2(across[:, 1], across[:, 0])
    return np.asarray(shows[np.rint(turn / (2 * np.pi / ANGLES)).astype(int) % ANGLES])

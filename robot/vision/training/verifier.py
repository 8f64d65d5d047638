"""Makes ``robot/vision/fruit/weights.npz``.

``python -m robot.vision.training.verifier --scenes DIR... --photos DIR --out FILE.npz``: scenes as ``labelled.scenes``
reads them, photographs as ``labelled.photos`` (split ``train``). The same data give the same weights.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from robot.vision.fruit.hypotheses import Hypotheses, mono_hypotheses, pair_hypotheses
from robot.vision.fruit.joint_fit import Spheroids
from robot.vision.fruit.judge import ORDER
from robot.vision.fruit.network import Network
from robot.vision.fruit.parameters import FruitParameters
from robot.vision.fruit.planes import Image, linear_light, planes_of
from robot.vision.fruit.rectify import ParallelPair
from robot.vision.fruit.shortlist import shortlist
from robot.vision.fruit.skin import skin_features
from robot.vision.training.fitting import fit_network
from robot.vision.training.labelled import Photo, Scene, photos, scenes
from robot.vision.values import Ripeness

Array = npt.NDArray[np.float64]
SKIN_PIXELS, OTHER_PIXELS = 400, 700
KIND_WEIGHT = {Ripeness.RED: 1.0, Ripeness.TURNING: 2.0, Ripeness.GREEN: 5.0}
CALYX = 100


@dataclass(slots=True)
class Table:
    """Rows of features with their targets and weights, gathered image by image."""

    features: list[npt.NDArray[np.float32]] = field(default_factory=list)
    targets: list[npt.NDArray[np.float32]] = field(default_factory=list)
    weights: list[npt.NDArray[np.float32]] = field(default_factory=list)

    def add(self, features: npt.ArrayLike, targets: npt.ArrayLike, weights: npt.ArrayLike) -> None:
        self.features.append(np.asarray(features, dtype=np.float32))
        self.targets.append(np.asarray(targets, dtype=np.float32))
        self.weights.append(np.asarray(weights, dtype=np.float32))

    def joined(self, other: Table) -> Table:
        return Table(self.features + other.features, self.targets + other.targets, self.weights + other.weights)

    def fit(self, hidden: tuple[int, ...], steps: int, decay: float) -> Network:
        return fit_network(
            np.concatenate(self.features),
            np.concatenate(self.targets),
            sample_weights=np.concatenate(self.weights),
            hidden=hidden,
            steps=steps,
            decay=decay,
        )


def add_scene_pixels(table: Table, scene: Scene, generator: np.random.Generator) -> None:
    """Pixels of both views, skin by the masks."""
    for image, mask in ((scene.left, scene.mask_left), (scene.right, scene.mask_right)):
        weight_of = np.ones(256, dtype=np.float32)
        for tomato in scene.tomatoes:
            weight_of[tomato.number] = KIND_WEIGHT[tomato.ripeness]
        skin = ((mask > 0) & (mask < CALYX)).astype(np.float32)
        _add_pixels(table, image, skin, weight_of[mask], generator)


def add_photo_pixels(table: Table, photo: Photo, generator: np.random.Generator, weight: float = 0.5) -> None:
    """Pixels of a photograph: the middle of each box is skin, outside all boxes is not, the rest is left out."""
    height, width = photo.image.shape[:2]
    skin = np.zeros((height, width), dtype=np.float32)
    weights = np.full((height, width), weight, dtype=np.float32)
    for x0, y0, x1, y1 in photo.boxes:
        weights[int(y0) : int(y1) + 1, int(x0) : int(x1) + 1] = 0.0
    for x0, y0, x1, y1 in photo.boxes:
        centre = (round((x0 + x1) / 2), round((y0 + y1) / 2))
        axes = (max(1, round(0.35 * (x1 - x0))), max(1, round(0.35 * (y1 - y0))))
        cv2.ellipse(skin, centre, axes, 0, 0, 360, 1.0, -1)
        cv2.ellipse(weights, centre, axes, 0, 0, 360, weight, -1)
    _add_pixels(table, photo.image, skin, weights, generator)


def _add_pixels(
    table: Table,
    image: Image,
    skin: npt.NDArray[np.float32],
    weights: npt.NDArray[np.float32],
    generator: np.random.Generator,
) -> None:
    planes = planes_of(image)
    share = cv2.resize(skin, planes.size, interpolation=cv2.INTER_AREA).ravel()
    weight = cv2.resize(weights, planes.size, interpolation=cv2.INTER_NEAREST).ravel()
    features = skin_features(planes)
    for pool, count in ((share > 0.5, SKIN_PIXELS), (share <= 0.5, OTHER_PIXELS)):
        rows = np.flatnonzero(pool & (weight > 0))
        rows = generator.choice(rows, min(count, len(rows)), replace=False)
        table.add(features[rows], share[rows, None], weight[rows])


def add_first_look(table: Table, scene: Scene, skin: Network, parameters: FruitParameters) -> None:
    """All hypotheses of a scene."""
    found = _hypotheses(scene, skin, parameters)
    if len(found.features):
        targets, _ = targets_of(found.fit, found.pair, scene)
        table.add(found.features, targets, np.ones(len(targets)))


def add_second_look(
    table: Table, tints: Table, scene: Scene, skin: Network, first: Network, parameters: FruitParameters
) -> None:
    """The shortlist of a scene, and the tints of the fruit measured well."""
    found = _hypotheses(scene, skin, parameters)
    if len(found.features) == 0:
        return
    full = linear_light(scene.left), linear_light(scene.right)
    best = shortlist(found, full, scene.rig, first, parameters.refined)
    targets, nearest = targets_of(best.fit, found.pair, scene)
    table.add(best.features, targets, np.ones(len(targets)))
    good = np.flatnonzero(targets[:, 1] > 0)
    kinds = [ORDER.index(scene.tomatoes[int(nearest[k])].ripeness) for k in good]
    tints.add(best.tint[good], np.eye(len(ORDER))[kinds].reshape(-1, len(ORDER)), np.ones(len(good)))


def _hypotheses(scene: Scene, skin: Network, parameters: FruitParameters) -> Hypotheses:
    return pair_hypotheses(linear_light(scene.left), linear_light(scene.right), scene.rig, skin, parameters)


def targets_of(fit: Spheroids, pair: ParallelPair, scene: Scene) -> tuple[Array, npt.NDArray[np.int64]]:
    """Targets (n, 2) and the index of the nearest fruit (n,).

    Within half a diameter and half the size it is a fruit; within 0.15 diameters and 8 % of it, measured well.
    """
    count = len(fit.radius_m)
    if not scene.tomatoes:
        return np.zeros((count, 2)), np.zeros(count, dtype=np.int64)
    centre = fit.centre_m @ pair.rect_from_left
    diameter = 2 * fit.volume_radius_m
    true_centre = np.array([t.centre_m for t in scene.tomatoes])
    true_diameter = np.array([t.diameter_m for t in scene.tomatoes])
    error = np.linalg.norm(centre[:, None] - true_centre[None], axis=2) / true_diameter
    nearest = error.argmin(axis=1)
    error = error[np.arange(count), nearest]
    size_error = np.abs(diameter / true_diameter[nearest] - 1)
    fruit = (error < 0.5) & (size_error < 0.5)
    return np.column_stack([fruit, (error < 0.15) & (size_error < 0.08)]).astype(np.float64), nearest


def add_photo_hypotheses(table: Table, photo: Photo, skin: Network, parameters: FruitParameters) -> None:
    """Circles of a photograph: an overlap (IoU) of the square with a box of 0.5 is a fruit, 0.7 is measured well."""
    found = mono_hypotheses(photo.image, skin, parameters)
    if len(found.circles) == 0:
        return
    height, width = photo.image.shape[:2]
    u, v, r = found.circles.T
    low_u, low_v = np.clip(u - r, 0, width), np.clip(v - r, 0, height)
    high_u, high_v = np.clip(u + r, 0, width), np.clip(v + r, 0, height)
    best = np.zeros(len(u))
    for x0, y0, x1, y1 in photo.boxes:
        shared = np.clip(np.minimum(high_u, x1) - np.maximum(low_u, x0), 0, None) * np.clip(
            np.minimum(high_v, y1) - np.maximum(low_v, y0), 0, None
        )
        union = (high_u - low_u) * (high_v - low_v) + (x1 - x0) * (y1 - y0) - shared
        best = np.maximum(best, shared / np.maximum(union, 1e-9))
    table.add(found.view.values, np.column_stack([best >= 0.5, best >= 0.7]), np.ones(len(u)))


def train(scene_folders: list[Path], photo_folder: Path) -> dict[str, npt.NDArray[np.float32]]:
    """All weights, by name."""
    generator = np.random.default_rng(7)
    parameters = FruitParameters()
    pixels, monos, tints, second = Table(), Table(), Table(), Table()
    halves = (Table(), Table())
    for _, scene in _numbered(scene_folders):
        add_scene_pixels(pixels, scene, generator)
    for photo in photos(photo_folder, "train"):
        add_photo_pixels(pixels, photo, generator)
    skin = pixels.fit((32, 16), steps=14000, decay=1e-5)
    for number, scene in _numbered(scene_folders):
        add_first_look(halves[number % 2], scene, skin, parameters)
    first_of_half = [half.fit((24,), steps=4000, decay=2e-3) for half in halves]
    for number, scene in _numbered(scene_folders):
        add_second_look(second, tints, scene, skin, first_of_half[1 - number % 2], parameters)
    for photo in photos(photo_folder, "train"):
        add_photo_hypotheses(monos, photo, skin, parameters)
    networks = {
        "skin": skin,
        "first": halves[0].joined(halves[1]).fit((24,), steps=6000, decay=2e-3),
        "final": second.fit((24,), steps=6000, decay=2e-3),
        "mono": monos.fit((24,), steps=6000, decay=2e-3),
        "ripeness": tints.fit((8,), steps=3000, decay=1e-4),
    }
    return {key: value for name, network in networks.items() for key, value in network.arrays(name).items()}


def _numbered(folders: list[Path]) -> Iterator[tuple[int, Scene]]:
    """All scenes with a running number; the second looks use a first verifier that has not seen the scene."""
    return enumerate(scene for folder in folders for scene in scenes(folder))


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m robot.vision.training.verifier", description=__doc__)
    parser.add_argument("--scenes", type=Path, nargs="+", required=True, help="folders of rendered stereo scenes")
    parser.add_argument("--photos", type=Path, required=True, help="folder of photographs with boxes and train.txt")
    parser.add_argument("--out", type=Path, required=True, help="the .npz file to write")
    options = parser.parse_args(arguments)
    cv2.setNumThreads(1)
    np.savez_compressed(options.out, **train(options.scenes, options.photos))  # type: ignore[arg-type]
    return 0


if __name__ == "__main__":
    sys.exit(main())

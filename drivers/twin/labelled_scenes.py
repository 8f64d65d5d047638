"""Stereo scenes of the twin's greenhouse with their truth, as files to train and to judge detectors by.

``python -m drivers.twin.labelled_scenes --out FOLDER --count N --seed S`` writes ``<id>_left.jpg``, ``<id>_right.jpg``,
``<id>.json`` and the calibrations that the scenes name. Metres in the left optical frame, pixels of the stored images.
"""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from drivers.twin.canvas import Rays
from drivers.twin.light import Light, light_at
from drivers.twin.optics import Eye, StereoOptics
from drivers.twin.plants import grow
from drivers.twin.renderer import EyeView, StereoRenderer
from drivers.twin.scene import Scene
from drivers.twin.sightings import outline_px
from drivers.twin.solids import TwinFruit

Array = npt.NDArray[np.float64]

SIZE = (640, 480)
JPEG_QUALITY = 95
OUTLINE_POINTS = 48
FOCAL_PX = 457.0
LEAST_SHOWN = 0.05  # of a fruit, for it to be in the truth at all


@dataclass(frozen=True, slots=True, eq=False)
class Rig:
    """A stereo rig under the name that the scenes give it."""

    name: str
    optics: StereoOptics

    def calibration(self) -> dict[str, Any]:
        left, right = self.optics.left, self.optics.right
        return {
            "rig": self.name,
            "image_size": list(self.optics.image_size),
            "K_left": left.K.tolist(), "K_right": right.K.tolist(),
            "dist_left": left.dist.tolist(), "dist_right": right.dist.tolist(),
            "R": right.R.tolist(), "t_m": right.t_m.tolist(),
        }  # fmt: skip


def draw_rig(name: str, generator: np.random.Generator) -> Rig:
    """A rig with the tolerances of a real one: unequal cameras, turned by up to a degree, with lens distortion."""
    K_left, K_right = (_camera(generator) for _ in range(2))
    dist_left, dist_right = (
        np.array([generator.uniform(-0.13, 0.0), generator.uniform(0.0, 0.03), 0.0, 0.0, 0.0]) for _ in range(2)
    )
    turn, _ = cv2.Rodrigues(np.radians(generator.uniform(-0.7, 0.7, 3)))
    R = np.asarray(turn, dtype=np.float64)
    t_m = -R @ np.array([generator.uniform(0.055, 0.065), *generator.uniform(-5e-4, 5e-4, 2)])
    return Rig(name, StereoOptics(SIZE, K_left, K_right, dist_left, dist_right, R, t_m))


def _camera(generator: np.random.Generator) -> Array:
    focal = FOCAL_PX * generator.uniform(0.98, 1.02)
    middle = np.array(SIZE) / 2 - 0.5 + generator.uniform(-6.0, 6.0, 2)
    return np.array([[focal, 0.0, middle[0]], [0.0, focal, middle[1]], [0.0, 0.0, 1.0]])


def draw_scene(generator: np.random.Generator, seed: int) -> Scene:
    """A row of any usual crop at any hour."""
    red, turning, _ = generator.dirichlet((2.0, 1.2, 2.0))
    return Scene(
        seed=seed,
        hour=float(generator.uniform(8.0, 20.0)),
        weather="clear" if generator.random() < 0.6 else "overcast",
        row_length_m=2.0,
        stem_distance_m=float(generator.uniform(0.55, 0.85)),
        wall_distance_m=float(generator.uniform(1.4, 2.5)),
        fruits_per_plant=float(generator.uniform(2.0, 9.0)),
        red_share=float(red), turning_share=float(turning), green_share=float(1.0 - red - turning),
        cluster_share=float(generator.uniform(0.1, 0.6)),
        leaf_density=float(generator.uniform(0.4, 1.8)),
    )  # fmt: skip


def exposure_for(light: Light, generator: np.random.Generator) -> tuple[float, float]:
    """Exposure (s) and gain as an exposure control would set them, somewhat off, within what a rover's camera does."""
    wanted = 0.004 * float(np.exp(generator.normal(0.0, 0.5))) / max(_brightness(light), 1e-6)
    exposure_s = min(max(wanted, 2e-4), 0.02)
    return exposure_s, min(max(wanted / exposure_s, 1.0), 8.0)


def _brightness(light: Light) -> float:
    """Light on the plants in shares of a clear noon's."""
    noon = light_at(12.0)
    total = light.sun_w_m2 + light.sky_w_m2 + light.lamp_w_m2
    return total / (noon.sun_w_m2 + noon.sky_w_m2)


def write_scene(folder: Path, name: str, rig: Rig, scene: Scene, generator: np.random.Generator) -> int:
    """Write one scene; the number of fruit in its truth."""
    greenhouse = grow(scene)
    renderer = StereoRenderer(greenhouse, rig.optics, scene.seed)
    lamp = scene.hour > 18.0 and generator.random() < 0.5
    light = light_at(scene.hour, scene.weather, lamp_on=bool(lamp))
    exposure_s, gain = exposure_for(light, generator)
    pose = _pose(generator)
    pictures = renderer.render(pose, light, exposure_s, gain)
    for side, picture in zip(("left", "right"), pictures, strict=True):
        cv2.imwrite(str(folder / f"{name}_{side}.jpg"), picture, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
    by_id = {fruit.id: fruit for fruit in greenhouse.fruits}
    eyes_from_row = _eyes_from_row(rig.optics, pose)
    rays = tuple(Rays(eye, SIZE) for eye in (rig.optics.left, rig.optics.right))
    tomatoes: list[dict[str, Any]] = []
    for seen in renderer.truth(pose):
        if max(seen.left.visible_fraction, seen.right.visible_fraction) < LEAST_SHOWN:
            continue
        fruit = by_id[seen.id]
        views = {
            side: _eye_truth(view, fruit, eye.eye, eye_from_row)
            for side, view, eye, eye_from_row in zip(
                ("left", "right"), (seen.left, seen.right), rays, eyes_from_row, strict=True
            )
        }
        if not all(view["outline_px"] for view in views.values()):
            continue  # partly behind an eye
        tomatoes.append(
            {
                "id": len(tomatoes) + 1, "centre_m": seen.centre_m.tolist(), "diameter_m": fruit.diameter_m,
                "ripeness": fruit.ripeness, "visible_fraction_min": seen.visible_fraction, **views,
            }
        )  # fmt: skip
    truth = {
        "scene_id": name, "rig": rig.name, "calib_file": f"calib_{rig.name}.json", "hour": scene.hour,
        "lamp": bool(lamp), "weather": scene.weather, "n_tomatoes": len(tomatoes), "tomatoes": tomatoes,
    }  # fmt: skip
    (folder / f"{name}.json").write_text(json.dumps(truth) + "\n", encoding="utf-8")
    return len(tomatoes)


def _eye_truth(view: EyeView, fruit: TwinFruit, eye: Eye, eye_from_row: Array) -> dict[str, Any]:
    outline = outline_px(fruit, eye, eye_from_row, OUTLINE_POINTS)
    return {
        "centre_px": view.centre_px.tolist(), "visible_fraction": view.visible_fraction,
        "bbox_unoccluded": list(view.bbox), "unoccluded_area_px": view.area_px2,
        "outline_px": [] if outline is None else np.round(outline, 3).tolist(),
    }  # fmt: skip


def _pose(generator: np.random.Generator) -> Array:
    """Row from camera: in the lane, facing the row at the left, tilted a little."""
    turn, _ = cv2.Rodrigues(np.radians(generator.uniform(-8.0, 8.0, 3)))
    pose = np.eye(4)
    pose[:3, :3] = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]]) @ turn
    pose[:3, 3] = (generator.uniform(0.5, 1.5), generator.uniform(0.0, 0.25), generator.uniform(0.6, 1.1))
    return pose


def _eyes_from_row(optics: StereoOptics, row_from_left: Array) -> tuple[Array, Array]:
    left_from_row = np.asarray(np.linalg.inv(row_from_left), dtype=np.float64)
    right_from_left = np.eye(4)
    right_from_left[:3, :3], right_from_left[:3, 3] = optics.right.R, optics.right.t_m
    return left_from_row, right_from_left @ left_from_row


def write_scenes(folder: Path, count: int, seed: int) -> int:
    """Write ``count`` scenes, the same for the same seed; the number of fruit in their truth."""
    folder.mkdir(parents=True, exist_ok=True)
    fruits = 0
    for k in range(count):
        generator = np.random.default_rng([seed, k])
        rig = draw_rig(f"twin_{seed}_{k:03d}", generator)
        (folder / f"calib_{rig.name}.json").write_text(json.dumps(rig.calibration()) + "\n", encoding="utf-8")
        fruits += write_scene(folder, f"twin_{seed}_{k:03d}", rig, draw_scene(generator, seed * 1000 + k), generator)
    return fruits


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m drivers.twin.labelled_scenes", description=__doc__)
    parser.add_argument("--out", type=Path, required=True, help="folder to write into")
    parser.add_argument("--count", type=int, required=True, help="number of scenes")
    parser.add_argument("--seed", type=int, default=1, help="the same seed gives the same scenes")
    options = parser.parse_args(arguments)
    cv2.setNumThreads(1)
    fruits = write_scenes(options.out, options.count, options.seed)
    sys.stdout.write(f"{options.count} scenes with {fruits} fruit in {options.out}\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())

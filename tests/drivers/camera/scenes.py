"""Pairs of many rows: hours, weather, gains, leaves before the lens, and what faults make of them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from drivers.camera.epipolar import StereoCalibration
from drivers.camera.values import Image, StereoFrame
from drivers.twin import Scene, StereoOptics
from drivers.twin.light import light_at
from drivers.twin.plants import grow
from drivers.twin.renderer import StereoRenderer
from drivers.twin.sensor import Sensor
from tests.drivers.twin import rig

EXPOSURES = ((0.004, 1.0), (0.001, 1.0), (0.004, 8.0), (0.030, 4.0), (0.0005, 16.0))
HOURS = (8.0, 12.0, 16.0, 19.0, 19.5, 20.0)


@dataclass(frozen=True)
class Taken:
    """A pair and the circumstances it was taken in."""

    left: Image
    right: Image
    what: str

    @property
    def frame(self) -> StereoFrame:
        return frame_of(self.left, self.right)


def frame_of(left: Image, right: Image, sequence: int = 1) -> StereoFrame:
    return StereoFrame(0.0, sequence, left, right, 0.004, 1.0)


def calibration() -> StereoCalibration:
    """What the robot is told of the rig's optics."""
    o = rig.nominal().optics
    return StereoCalibration(o.image_size, o.K_left, o.dist_left, o.K_right, o.dist_right, o.R, o.t_m)


def pairs(seeds: range, turned_deg: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Iterator[Taken]:
    """Each seed a row: 12 to 16 pairs in all lights and at all gains; every third from 0.3 m nearer to the leaves.

    ``turned_deg``: by how much the right eye has turned about its axes since it was calibrated.
    """
    for seed in seeds:
        dice = np.random.default_rng([seed, 77])
        weather = ("clear", "overcast")[seed % 2]
        scene = Scene(
            seed=seed, row_length_m=2.0, weather=weather, leaf_density=(1.0, 2.0, 0.5)[seed % 3],
            stem_distance_m=(0.70, 0.55, 0.90)[seed // 2 % 3],
        )  # fmt: skip
        renderer = StereoRenderer(grow(scene), turned_optics(turned_deg), seed)
        for hour in HOURS:
            for lamp in (False, True) if hour >= 19.0 else (False,):
                light = light_at(hour, weather, lamp_on=lamp)
                exposure_s, gain = EXPOSURES[int(dice.integers(len(EXPOSURES)))]
                near_m = 0.3 if dice.random() < 0.33 else 0.0
                pose = camera_pose(dice.uniform(0.0, 1.8), near_m, dice.uniform(-0.2, 0.2))
                left, right = renderer.render(pose, light, exposure_s, gain, (), int(dice.integers(1_000_000)))
                what = f"row {seed}, {weather}, {hour} h, lamp {lamp}, {exposure_s} s, gain {gain}, {near_m} m nearer"
                yield Taken(left, right, what)


def turned_optics(turned_deg: tuple[float, float, float]) -> StereoOptics:
    o = rig.nominal().optics
    turn = Rotation.from_rotvec(np.radians(turned_deg)).as_matrix()
    return StereoOptics(o.image_size, o.K_left, o.K_right, o.dist_left, o.dist_right, turn.T @ o.R, o.t_m)


def camera_pose(x_m: float, near_m: float, heading_rad: float) -> np.ndarray:
    pose = np.eye(4)
    pose[:2, :2] = [[np.cos(heading_rad), -np.sin(heading_rad)], [np.sin(heading_rad), np.cos(heading_rad)]]
    pose[:2, 3] = x_m, near_m
    return np.asarray(pose @ rig.nominal().base_from_camera)


def compressed(taken: Taken) -> Taken:
    """As it comes over the stream."""
    _, data = cv2.imencode(".jpg", np.hstack((taken.left, taken.right)), [cv2.IMWRITE_JPEG_QUALITY, 92])
    whole = cv2.imdecode(data, cv2.IMREAD_COLOR)
    width = whole.shape[1] // 2
    return Taken(whole[:, :width].copy(), whole[:, width:].copy(), taken.what + ", compressed")


def fogged(view: Image, sigma_px: float) -> Image:
    """A film before the lens; the sensor's noise is as it was."""
    noise = np.random.default_rng(0).normal(0.0, 2.0, view.shape)
    return np.clip(cv2.GaussianBlur(view, (0, 0), sigma_px) + noise, 0, 255).astype(np.uint8)


def dark(gain: float, sequence: int, eye: int) -> Image:
    """What the sensor gives under a cap."""
    sensor = Sensor((640, 480), 3)
    return sensor.expose(np.zeros((480, 640, 4), np.uint8), 1.0, 0.004, gain, sequence, eye, noise=True)


def under_tape(level: float) -> Image:
    """Light through something right before the lens: a soft gradient and noise."""
    slope = np.linspace(-1.5, 1.5, 640)[None, :, None]
    noise = np.random.default_rng(1).normal(0.0, 2.0, (480, 640, 3))
    return np.clip(level + slope + noise, 0, 255).astype(np.uint8)

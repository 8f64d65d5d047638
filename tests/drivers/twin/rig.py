"""A machine as a configuration would describe it, and twins of it."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from drivers.twin import FaultPlan, Nominal, Scene, StereoOptics, TruthLog, Twin, exact, parse_fault
from drivers.twin.plants import grow
from drivers.twin.renderer import StereoRenderer

URDF = Path(__file__).parents[3] / "configs" / "arms" / "viperx300_nozzle.urdf"
STOW_RAD = (0.0, -1.2, 1.2, 0.0, 0.5, 0.0)
POINTING_RAD = (0.0, 0.2, -0.2, 0.0, 0.0, 0.0)  # nozzle level, towards the row


@cache
def scene() -> Scene:
    return Scene(seed=4, row_length_m=0.45)


def nominal(**changes: Any) -> Nominal:
    K = np.array([[457.0, 0.0, 319.5], [0.0, 457.0, 239.5], [0.0, 0.0, 1.0]])
    optics = StereoOptics((640, 480), K, K, np.zeros(5), np.zeros(5), np.eye(3), np.array([-0.06, 0.0, 0.0]))
    base_from_camera = np.eye(4)
    base_from_camera[:3] = [[1.0, 0.0, 0.0, -0.03], [0.0, 0.0, 1.0, 0.05], [0.0, -1.0, 0.0, 0.88]]
    base_from_arm = np.eye(4)
    base_from_arm[:3] = [[0.0, -1.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.05], [0.0, 0.0, 1.0, 0.42]]
    told: dict[str, Any] = {
        "optics": optics,
        "base_from_camera": base_from_camera,
        "base_from_arm": base_from_arm,
        "urdf_text": URDF.read_text(),
        "stow_rad": STOW_RAD,
    }
    return Nominal(**told | changes)


def twin(*faults: str, seed: int = 5, truth: TruthLog | None = None, drawn: bool = False, **changes: Any) -> Twin:
    """A twin of the nominal machine; with ``drawn`` its true parameters differ as seed says."""
    told = nominal(**changes)
    plan = FaultPlan(parse_fault(fault) for fault in faults)
    machine = Twin(told, scene(), seed, truth, plan, None if drawn else exact(told))
    machine.renderer = _renderer(seed)  # the same for all: what it keeps between pictures changes none of them
    return machine


@cache
def _renderer(seed: int) -> StereoRenderer:
    return StereoRenderer(grow(scene()), nominal().optics, seed)


def quintic(start: tuple[float, ...], goal: tuple[float, ...], duration_s: float, at_s: float) -> tuple[float, ...]:
    """A smooth motion from rest to rest."""
    s = min(max(at_s / duration_s, 0.0), 1.0)
    share = 10 * s**3 - 15 * s**4 + 6 * s**5
    return tuple(a + (b - a) * share for a, b in zip(start, goal, strict=True))


@cache
def aimed() -> tuple[tuple[float, ...], int]:
    """Joint angles, for the base at the origin, whose nozzle points at a fruit from near; and the fruit's id."""
    machine = twin()
    rng = np.random.default_rng(0)
    low = [joint.low_rad for joint in machine.physics.geometry.joints]
    high = [joint.high_rad for joint in machine.physics.geometry.joints]
    best: tuple[float, tuple[float, ...], int] = (np.inf, STOW_RAD, 0)
    for angles in rng.uniform(0.7 * np.array(low), 0.7 * np.array(high), (1500, 6)):
        pose = machine.physics.row_from_arm @ machine.physics.geometry.nozzle_pose(angles)
        for fruit in machine.greenhouse.fruits:
            way = fruit.centre_m - pose[:3, 3]
            ahead = float(way @ pose[:3, 0])
            beside = float(np.linalg.norm(way - ahead * pose[:3, 0]))
            if 0.5 * fruit.diameter_m + 0.04 < ahead < 0.5 * fruit.diameter_m + 0.12 and beside < best[0]:
                best = (beside, tuple(angles.tolist()), fruit.id)
    return best[1], best[2]

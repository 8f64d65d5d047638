"""CPU time of the twin's camera: ``python -m drivers.twin.bench_renderer``."""

from __future__ import annotations

import statistics
import sys
import time

import cv2
import numpy as np

from drivers.twin.light import light_at
from drivers.twin.optics import StereoOptics
from drivers.twin.plants import grow
from drivers.twin.renderer import StereoRenderer
from drivers.twin.scene import Scene

PAIRS = 60


def main() -> None:
    """Write out the milliseconds of CPU a 640x480 pair takes, noise included, on one thread."""
    cv2.setNumThreads(1)
    K = np.array([[457.0, 0.0, 319.5], [0.0, 457.0, 239.5], [0.0, 0.0, 1.0]])
    optics = StereoOptics((640, 480), K, K, np.zeros(5), np.zeros(5), np.eye(3), np.array([-0.06, 0.0, 0.0]))
    renderer = StereoRenderer(grow(Scene()), optics, seed=1)
    light = light_at(12.0)
    start = time.process_time()
    renderer.render(_pose(0.0), light)
    first_ms = 1e3 * (time.process_time() - start)
    moving: list[float] = []
    standing: list[float] = []
    for frame in range(PAIRS):
        place = _pose(0.2 + 3.4 * frame / PAIRS)
        for times in (moving, standing):
            start = time.process_time()
            renderer.render(place, light, frame=frame)
            times.append(1e3 * (time.process_time() - start))
    lines = [f"first picture in a new light (shadows)  {first_ms:6.1f} ms"]
    for name, times in (("a pair from a new pose", moving), ("a pair from the same pose", standing)):
        middle, spread = statistics.median(times), statistics.quantiles(times, n=20)
        lines.append(f"{name:38s}  {middle:6.1f} ms median, {spread[0]:.1f} to {spread[-1]:.1f} (5 to 95 %)")
    sys.stdout.write("\n".join(lines) + "\n")


def _pose(x_m: float) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    """Row from camera: looking along +y from 0.88 m above the lane."""
    return np.array([[1.0, 0.0, 0.0, x_m], [0.0, 0.0, 1.0, 0.05], [0.0, -1.0, 0.0, 0.88], [0.0, 0.0, 0.0, 1.0]])


if __name__ == "__main__":
    main()

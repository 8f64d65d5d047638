"""Position and size of guessed fruit: trace the outlines round the guess, fit the shape, look again more closely."""

from __future__ import annotations

from dataclasses import dataclass, fields

import cv2
import numpy as np
import numpy.typing as npt

from robot.vision.fruit.joint_fit import ITERATIONS, Spheroids, fit_spheroids, outline_rays
from robot.vision.fruit.polar import ANGLES, STEPS, TURN_RAD, sample_places, unrolled
from robot.vision.fruit.rectify import ParallelPair
from robot.vision.stereo_rig import StereoRig

Array = npt.NDArray[np.float64]
Image = npt.NDArray[np.uint8]

WIDE, NARROW = 0.42, 0.16
"""How far the band of the first and of the second look reaches, in shares of the radius."""
FINEST_PX = 0.08
"""No edge is known better than this."""


@dataclass(frozen=True, slots=True, eq=False)
class Traced:
    """n fruit: ``fit``; ``sigma_px`` (n, 2, ANGLES) of the edges, ``shows`` (n, 2, ANGLES) chance that each is to be
    seen; ``verdict`` (n, 2) logits: it is a fruit, its visible share."""

    fit: Spheroids
    sigma_px: Array
    shows: Array
    verdict: Array

    def __getitem__(self, rows: npt.NDArray[np.int64]) -> Traced:
        """Some of them."""
        return Traced(*(getattr(self, field.name)[rows] for field in fields(self)))


def trace(
    centre_m: Array, radius_m: Array, harmonic: Array, reach: float, images: tuple[Image, Image], rig: StereoRig,
    pair: ParallelPair, net: cv2.dnn.Net, iterations: int = ITERATIONS,
) -> Traced:  # fmt: skip
    """One look at n guesses: ``centre_m`` (n, 3) in the pair's frame, ``radius_m`` (n,), ``harmonic`` (n, 2)."""
    places, band = sample_places(centre_m, radius_m, harmonic, np.full(len(radius_m), reach), rig, pair)
    said, verdict = answers(net, unrolled(images, places))
    offset, spread, shows = said[:, 0], said[:, 1], said[:, 2]
    step_rad = 2 * band / (STEPS - 1)
    beyond = offset * step_rad[:, None, None]
    rays = outline_rays(centre_m, radius_m, harmonic, pair.eyes_m, TURN_RAD, beyond[..., None])[..., 0, :]
    step_px = step_rad * pair.focal_px
    sigma = np.maximum(np.exp(np.clip(spread, -3.5, 2.5)) * step_px[:, None, None], FINEST_PX)
    start = np.column_stack([centre_m, radius_m])
    fit = fit_spheroids(rays, sigma, pair.eyes_m, start, harmonic, pair.focal_px, iterations)
    return Traced(fit, sigma, 0.5 * (1 + np.tanh(0.5 * shows)), verdict)


def answers(net: cv2.dnn.Net, planes: npt.NDArray[np.float32]) -> tuple[Array, Array]:
    """(n, 3, 2, ANGLES) offsets, log sigmas and logits that the edge shows; (n, 2) verdicts."""
    count = len(planes)
    rays = np.zeros((count, 6 * ANGLES))
    verdict = np.zeros((count, 2))
    for k in range(count):  # one by one: a batch is no faster, and one of another size has its memory laid out anew
        net.setInput(planes[k : k + 1])
        rays[k], verdict[k] = (np.asarray(out)[0] for out in net.forward(("rays", "verdict")))
    return rays.reshape(count, 3, 2, ANGLES), verdict

"""The last step of the measurement: sub-pixel edges in the stored images at full resolution, and the joint fit to them.

Sample positions are projected through the lens model; pixels are not resampled beforehand. Edges are sought in linear
light, in which a symmetric blur does not move them.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from robot.vision.fruit.contour import sample
from robot.vision.fruit.joint_fit import Spheroids, fit_spheroids, outline_rays
from robot.vision.fruit.planes import Plane, dark_level
from robot.vision.fruit.rectify import ParallelPair
from robot.vision.stereo_rig import StereoRig

Array = npt.NDArray[np.float64]
ANGLES = 48
STEPS = 19
WINDOW_SHARES = (0.16, 0.08)
"""Half-width of the search round the outline, as a share of its radius, one a round."""
SMALLEST_WINDOW_PX = 2.5


def refine(fit: Spheroids, full: tuple[Plane, Plane], rig: StereoRig, pair: ParallelPair) -> Spheroids:
    """The same fruit measured in the (height, width, 3) linear light of both stored images."""
    if len(fit.radius_m) == 0:
        return fit
    focal = 0.5 * float(rig.K_left[0, 0] + rig.K_right[0, 0])
    dark = dark_level(full[0])
    turn: Array = np.arange(ANGLES, dtype=np.float64) * (2 * np.pi / ANGLES)
    for share in WINDOW_SHARES:
        radius_px = fit.radius_m / fit.centre_m[:, 2] * focal
        window = np.maximum(share * radius_px, SMALLEST_WINDOW_PX)
        offset_px = window[:, None] * np.linspace(-1.0, 1.0, STEPS)
        ends = np.asarray(offset_px[:, [0, STEPS // 2, -1]] / focal, dtype=np.float64)
        rays = outline_rays(fit.centre_m, fit.radius_m, fit.harmonic, pair.eyes_m, turn, ends)
        profile = np.stack([_seen(full[eye], rays[:, eye], eye, rig, pair) for eye in range(2)], axis=1)
        place, strength = _edges(profile, 2 * window / (STEPS - 1), dark)
        rows = np.arange(len(window))[:, None, None]
        found_px = np.interp(place, np.arange(STEPS), np.linspace(-1.0, 1.0, STEPS)) * window[rows]
        edge_rays = _between(rays, found_px, window)
        start = np.column_stack([fit.centre_m, fit.radius_m])
        fit = fit_spheroids(edge_rays, strength, pair.eyes_m, start, focal)
    return fit


def _seen(light: Plane, rays: Array, eye: int, rig: StereoRig, pair: ParallelPair) -> Plane:
    """(n, k, STEPS, 3) linear light from the first of three rays (n, k, 3, 3) over the second to the third.

    The rays are of the parallel pair's frame; between their pixels the lens is followed by a parabola.
    """
    flat = rays.reshape(-1, 3)
    if eye == 0:
        pixels = rig.project_left(flat @ pair.rect_from_left)
    else:
        in_right = flat @ pair.rect_from_right
        pixels = rig.project_right((in_right - rig.t_m) @ rig.R)
    first, middle, last = np.moveaxis(pixels.reshape(*rays.shape[:-1], 2), -2, 0)
    along = np.linspace(-1.0, 1.0, STEPS)[:, None]
    bend = 0.5 * (first + last) - middle
    place = middle[..., None, :] + along * (0.5 * (last - first))[..., None, :] + along**2 * bend[..., None, :]
    height, width = light.shape[:2]
    out = sample(light, place[..., 0], place[..., 1])
    beyond = (middle < 1).any(axis=-1) | (middle[..., 0] > width - 2) | (middle[..., 1] > height - 2)
    out[beyond] = 0.0
    return out


def _edges(profile: Plane, step_px: Array, dark: float) -> tuple[Array, Array]:
    """Index of the edge along each profile (n, 2, k) and its strength, 0..1."""
    smooth = np.roll(profile, 1, axis=2) + np.roll(profile, -1, axis=2)
    smooth += 2 * profile
    smooth /= 4
    slope = np.zeros_like(smooth)
    slope[..., 1:-1, :] = (smooth[..., 2:, :] - smooth[..., :-2, :]) / (2 * step_px[:, None, None, None, None])
    level = smooth.sum(axis=-1).mean(axis=-1) / 3 + dark
    size = np.sqrt((slope**2).sum(axis=-1)) / level[..., None]
    steps = profile.shape[3]
    nearness = np.exp(-0.5 * (np.linspace(-1, 1, steps) / 0.5) ** 2)
    best = np.clip((size * nearness).argmax(axis=-1), 1, steps - 2)[..., None]
    before, here, after = (np.take_along_axis(size, best + k, axis=-1)[..., 0] for k in (-1, 0, 1))
    bend = 2 * here - before - after
    step = np.where(bend > 1e-9, np.clip(0.5 * (after - before) / np.maximum(bend, 1e-9), -0.5, 0.5), 0.0)
    return best[..., 0] + step.astype(np.float64), np.asarray(here / (here + 0.08), dtype=np.float64) + 1e-4


def _between(rays: Array, found_px: Array, window_px: Array) -> Array:
    """The unit rays (n, 2, k, 3) at ``found_px`` (n, 2, k) beyond the outline; ``rays`` span the window evenly."""
    share = (0.5 * (found_px / window_px[:, None, None] + 1.0))[..., None]
    out = rays[..., 0, :] * (1 - share) + rays[..., -1, :] * share
    return np.asarray(out / np.linalg.norm(out, axis=-1, keepdims=True))

"""The outlines of spheres in the stored images."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from robot.vision.stereo_rig import StereoRig

Array = npt.NDArray[np.float64]

TURN_RAD: Array = np.arange(32, dtype=np.float64) * (2 * np.pi / 32)


def outline_circles(centre_m: Array, radius_m: Array, rig: StereoRig) -> Array:
    """(n, 2, 3) circles (u, v, r) of the areas of n spheres' outlines in the stored left and right image.

    ``centre_m`` (n, 3) in the left camera frame, ``radius_m`` (n,).
    """
    out = np.empty((len(radius_m), 2, 3))
    for eye, (place, project) in enumerate(
        ((np.zeros(3), rig.project_left), (-rig.R.T @ rig.t_m, rig.project_right))
    ):
        to_centre = centre_m - place
        distance = np.linalg.norm(to_centre, axis=1)
        axis = to_centre / distance[:, None]
        sine = np.minimum(radius_m / distance, 0.99)
        across = np.column_stack([-axis[:, 2], np.zeros(len(axis)), axis[:, 0]])
        across /= np.linalg.norm(across, axis=1)[:, None]
        down = np.cross(axis, across)
        rim_centre = place + axis * (distance * (1 - sine**2))[:, None]
        rim = (radius_m * np.sqrt(1 - sine**2))[:, None, None]
        spokes = np.cos(TURN_RAD)[:, None] * across[:, None] + np.sin(TURN_RAD)[:, None] * down[:, None]
        points = project((rim_centre[:, None] + rim * spokes).reshape(-1, 3)).reshape(*spokes.shape[:2], 2)
        middle = points.mean(axis=1)
        x, y = np.moveaxis(points - middle[:, None], 2, 0)
        area = 0.5 * np.abs((x * np.roll(y, -1, axis=1) - y * np.roll(x, -1, axis=1)).sum(axis=1))
        out[:, eye, :2], out[:, eye, 2] = middle, np.sqrt(area / np.pi)
    return out
